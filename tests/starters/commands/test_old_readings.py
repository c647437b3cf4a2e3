"""What decides about a motor is read after a standstill, and not long before the write."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from gateway.line.rtu.outcome import Outcome
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.records import Phase
from gateway.starters.commands.execution import CLEARS_FOR_S, DECIDES_FOR_S
from gateway.starters.policy.request import WITHOUT_TTL_S
from tests.starters.fakes import READY, REMOTE, RUN_COIL, TRANSACTION_S, VB01
from tests.starters.rig import CommandRig, virtually
from tests.starters.rules import ready

LOCAL = READY & ~REMOTE
STANDSTILL_S = 7.0
RESET_COIL = 107  # ssw07 5.3.2


def after_reading(call: Callable[[], None], *, times: int = 1) -> Callable[[Request], Outcome | None]:
    """Have something done right after the status was read, so many times."""
    left = [times]

    def rule(request: Request) -> Outcome | None:
        if (
            isinstance(request, ReadHoldingRegisters)
            and request.address <= VB01 < request.address + request.count
        ) and left[0]:
            left[0] -= 1
            asyncio.get_running_loop().call_soon(call)
        return None

    return rule


def hold_line(rig: CommandRig, seconds: float) -> None:
    """Keep the line from everything else: no processor, or other work."""

    async def hold() -> None:
        async with rig.line._bus:
            await asyncio.sleep(seconds)

    rig.tasks.append(asyncio.ensure_future(hold()))


def to_local(rig: CommandRig) -> None:
    rig.unit.holding[VB01] = LOCAL


@pytest.mark.parametrize("verb", ["start", "reset", "jog"])
@virtually
async def test_a_write_that_could_not_go_out_soon_after_the_reading_is_decided_again(verb: str) -> None:
    rig = await ready()

    def stand_still() -> None:
        hold_line(rig, STANDSTILL_S)
        to_local(rig)

    rig.line.rules.append(after_reading(stand_still))
    rig.submit(verb, args={"on": True} if verb == "jog" else {})
    await asyncio.sleep(30.0)

    assert rig.sink.final().phase is Phase.REJECTED
    assert not [each for each in rig.line.writes if isinstance(each, WriteCoil)]


@virtually
async def test_a_start_that_is_still_allowed_is_written_on_the_later_reading() -> None:
    rig = await ready()
    rig.line.rules.append(after_reading(lambda: hold_line(rig, STANDSTILL_S)))

    rig.submit("start")
    await asyncio.sleep(30.0)

    written_s = next(sent.at_s for sent in rig.line.sent if sent.request.is_write)
    reads_s = [sent.at_s for sent in rig.line.sent if not sent.request.is_write and sent.at_s < written_s]
    assert rig.sink.final().phase is Phase.CONFIRMED
    assert rig.starts() == 1
    assert written_s - reads_s[-1] < DECIDES_FOR_S
    assert written_s > STANDSTILL_S


@virtually
async def test_a_start_that_expires_meanwhile_is_not_written() -> None:
    rig = await ready()
    rig.line.rules.append(after_reading(lambda: hold_line(rig, STANDSTILL_S)))

    rig.submit("start", expires_s=rig.clock.now_s() + 5.0)
    await asyncio.sleep(30.0)

    assert rig.sink.final().code == "expired"
    assert rig.starts() == 0


@virtually
async def test_a_line_that_is_never_free_in_time_ends_the_command_in_the_end() -> None:
    rig = await ready()
    rig.line.rules.append(after_reading(lambda: hold_line(rig, 3.0), times=1000))

    rig.submit("start")
    await asyncio.sleep(WITHOUT_TTL_S + 0.1)

    assert rig.sink.final().code == "expired"
    assert "nothing was written" in rig.sink.final().text
    assert rig.starts() == 0


@virtually
async def test_what_was_read_before_a_standstill_decides_nothing_however_short_ago() -> None:
    rig = await ready()

    def sleep_with_the_machine() -> None:  # which the steady clock does not count
        rig.stood_still_s = rig.clock.now_s() + TRANSACTION_S
        to_local(rig)

    rig.line.rules.append(after_reading(sleep_with_the_machine))
    rig.submit("start")
    await asyncio.sleep(30.0)

    assert rig.sink.final().phase is Phase.REJECTED
    assert rig.starts() == 0


@virtually
async def test_a_poll_of_before_a_standstill_is_none_of_the_two_readings() -> None:
    rig = await ready()
    rig.poll()
    await asyncio.sleep(0.01)
    rig.stood_still_s = rig.clock.now_s()

    rig.submit("start")
    await asyncio.sleep(5.0)

    first_write = next(place for place, sent in enumerate(rig.line.sent) if sent.request.is_write)
    assert first_write == 2  # two fresh readings before it
    assert rig.starts() == 1


@virtually
async def test_the_second_write_of_a_command_does_not_follow_long_after_the_first() -> None:
    rig = await ready()
    rig.unit.holding[VB01] |= 0x8000  # a fault, which two writes reset

    def stand_still(request: Request) -> Outcome | None:
        if isinstance(request, WriteCoil) and request.address == RESET_COIL and not request.is_on:
            asyncio.get_running_loop().call_soon(lambda: hold_line(rig, STANDSTILL_S))
        return None

    rig.line.rules.append(stand_still)
    rig.submit("reset")
    await asyncio.sleep(30.0)

    coils = [each for each in rig.line.writes if isinstance(each, WriteCoil)]
    assert [each.is_on for each in coils if each.address == RESET_COIL] == [False]
    assert rig.sink.final().phase is Phase.UNCONFIRMED
    assert rig.sink.final().code == "not_seen"


@virtually
async def test_a_stop_goes_out_however_late() -> None:
    rig = await ready()
    hold_line(rig, STANDSTILL_S)
    await asyncio.sleep(0.0)

    rig.submit("stop")
    await asyncio.sleep(30.0)

    assert rig.sink.final().phase is Phase.CONFIRMED
    assert rig.stops()


@pytest.mark.parametrize("held_s", [1.0, STANDSTILL_S])
@virtually
async def test_who_commands_the_motor_is_changed_soon_after_run_0_or_not_at_all(held_s: float) -> None:
    rig = await ready()
    rig.unit.holding |= {230: 1}

    def hold_after_run_off(request: Request) -> Outcome | None:
        if request == WriteCoil(RUN_COIL, False):
            asyncio.get_running_loop().call_soon(lambda: hold_line(rig, held_s))
        return None

    rig.line.rules.append(hold_after_run_off)
    rig.submit("set", args={"parameter": "P230", "value": 2})
    await asyncio.sleep(30.0)

    is_in_time = held_s < CLEARS_FOR_S
    assert rig.sink.final().phase is (Phase.CONFIRMED if is_in_time else Phase.UNCONFIRMED)
    assert (WriteRegister(230, 2) in rig.line.writes) is is_in_time
