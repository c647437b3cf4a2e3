"""What the result says when run = 0 was written first, and when it was not taken."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gateway.line.rtu.outcome import Garbled, Refused, Silent
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters
from gateway.modbus.writes import WriteCoil
from gateway.records import Phase
from tests.starters.fakes import ENABLED, FAULT, READY, REMOTE, VB01, VB03
from tests.starters.rig import CommandRig, virtually

RUN_OFF, JOG_OFF = WriteCoil(100, False), WriteCoil(102, False)
RESET = [WriteCoil(107, False), WriteCoil(107, True)]


async def in_fault() -> CommandRig:
    """Return an SSW-07 in fault, whose fault goes when it is reset."""
    rig = CommandRig("ssw07")
    await rig.online()
    rig.unit.holding[VB01] = READY | FAULT

    def obey(request: Any) -> None:
        if request == RESET[1]:
            rig.unit.holding[VB01] = READY

    rig.unit.on_write = obey
    return rig


@virtually
async def test_a_jog_that_is_not_set_up_may_be_refused() -> None:
    rig = await in_fault()
    rig.line.rules.append(lambda r: Refused(3, 0.0) if r == JOG_OFF else None)

    rig.submit("reset")
    await asyncio.sleep(20.0)

    assert rig.sink.final().phase is Phase.CONFIRMED


@pytest.mark.parametrize(
    ("outcome", "phase", "code"),
    [(Refused(3, 0.0), Phase.FAILED, "run_not_cleared"), (Silent(), Phase.UNCONFIRMED, "no_answer")],
    ids=["refused", "not answered"],
)
@virtually
async def test_when_run_0_is_not_taken_nothing_else_is_written(outcome: Any, phase: Phase, code: str) -> None:
    rig = await in_fault()
    rig.line.rules.append(lambda r: outcome if r == RUN_OFF else None)

    rig.submit("reset")
    await asyncio.sleep(20.0)

    assert (rig.sink.final().phase, rig.sink.final().code) == (phase, code)
    assert "nothing else was written" in rig.sink.final().text
    assert "turning" not in rig.sink.final().text
    assert rig.line.writes == [RUN_OFF]


@virtually
async def test_when_the_run_command_still_reads_1_nothing_else_is_written() -> None:
    rig = await in_fault()
    rig.unit.holding[VB03] = 0x13
    rig.unit.on_write = lambda request: None

    rig.submit("reset")
    await asyncio.sleep(20.0)

    assert (rig.sink.final().phase, rig.sink.final().code) == (Phase.FAILED, "run_not_cleared")
    assert rig.line.writes == [RUN_OFF]


def hide_the_run_command(request: Any) -> Any:
    """Refuse every read of the coils of commands or of their word."""
    coils = isinstance(request, ReadCoils) and request.address + request.count > 100
    words = isinstance(request, ReadHoldingRegisters)
    is_word = words and request.address <= VB03 < request.address + request.count
    return Refused(2, 0.0) if coils or is_word else None


@pytest.mark.parametrize(
    ("verb", "args", "status"),
    [
        ("reset", {}, READY | FAULT),
        ("general_enable", {"value": True}, READY & ~ENABLED),
        ("local_remote", {"value": "remote"}, READY & ~REMOTE),
        ("set", {"parameter": "P230", "value": 2}, READY),
    ],
)
@virtually
async def test_where_run_cannot_be_read_its_acknowledgement_and_a_motor_at_rest_suffice(
    verb: str, args: dict[str, Any], status: int
) -> None:
    rig = CommandRig("ssw07")
    rig.line.rules.append(hide_the_run_command)
    rig.unit.holding |= {220: 6, 230: 1}
    await rig.online()
    rig.unit.holding[VB01] = status

    def obey(request: Any) -> None:
        if request not in (RUN_OFF, JOG_OFF):
            rig.unit.holding[VB01] = READY

    rig.unit.on_write = obey
    rig.submit(verb, args=args)
    await asyncio.sleep(20.0)

    assert rig.sink.phases()[-1] == ("confirmed", "ok")
    assert rig.line.writes[0] == RUN_OFF
    assert len(rig.line.writes) > 2


@pytest.mark.parametrize("outcome", [Silent(), Garbled("it may be older", b""), Refused(5, 0.0)])
@virtually
async def test_where_run_cannot_be_read_nothing_follows_a_run_0_that_is_not_acknowledged(
    outcome: Any,
) -> None:
    rig = await in_fault()
    rig.line.rules += [hide_the_run_command, lambda r: outcome if r == RUN_OFF else None]

    rig.submit("reset")
    await asyncio.sleep(20.0)

    assert rig.sink.final().phase is not Phase.CONFIRMED
    assert set(map(str, rig.line.writes)) == {str(RUN_OFF)}


@virtually
async def test_where_run_cannot_be_read_nothing_else_is_written_once_the_motor_runs() -> None:
    rig = await in_fault()
    rig.line.rules.append(hide_the_run_command)
    rig.unit.on_write = lambda request: rig.unit.holding.update({VB01: READY | FAULT | 1})

    rig.submit("reset")
    await asyncio.sleep(20.0)

    assert (rig.sink.final().phase, rig.sink.final().code) == (Phase.UNCONFIRMED, "motor_running")
    assert rig.line.writes == [RUN_OFF]


@pytest.mark.parametrize("exception", [4, 6])
@virtually
async def test_where_reading_run_is_refused_for_another_reason_nothing_else_is_written(
    exception: int,
) -> None:
    rig = await in_fault()
    rig.line.rules.append(lambda r: Refused(exception, 0.0) if hide_the_run_command(r) else None)

    rig.submit("reset")
    await asyncio.sleep(20.0)

    assert rig.sink.final().code == "run_not_cleared"
    assert rig.line.writes == [RUN_OFF]


@virtually
async def test_a_motor_that_starts_at_a_reset_is_stopped_and_the_result_says_so() -> None:
    rig = await in_fault()

    def start(request: Any) -> None:
        if request == RESET[1]:
            rig.unit.holding[VB01] = READY | 1

    rig.unit.on_write = start
    rig.submit("reset")
    await asyncio.sleep(20.0)

    assert (rig.sink.final().phase, rig.sink.final().code) == (Phase.UNCONFIRMED, "not_seen")
    assert "the motor may be turning" in rig.sink.final().text
    assert rig.line.writes[-2:] == [RUN_OFF, JOG_OFF]
