"""A start that was seen not to act is taken back: run = 0 until that shows, and only a motor that stands."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from gateway.errors import CommandError
from gateway.line.rtu.outcome import Outcome, Silent
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.records import Phase
from gateway.starters.commands.execution import MAY_STAND, MOST_TAKE_BACKS
from tests.starters.fakes import AT_SPEED, READY, REMOTE, VB01, VB03
from tests.starters.rig import CommandRig, virtually
from tests.starters.rules import ready

START, RUN_OFF, JOG, JOG_OFF = (WriteCoil(coil, is_on) for coil in (100, 102) for is_on in (True, False))
STATUS, WORD = 680, 685  # of an SSW900
TAKEN, NOT_TAKEN = "so that it cannot start later", "not seen to be taken"


async def hindered() -> CommandRig:
    """Return an SSW-07 whose motor something hinders; its command word says what was commanded last."""
    rig = await ready()

    def take(request: Request) -> None:
        if isinstance(request, WriteCoil):
            bit = 1 << (request.address - 100)
            word = rig.unit.holding[VB03] & ~bit
            rig.unit.holding[VB03] = word | bit if request.is_on else word

    rig.unit.on_write = take
    return rig


async def end_of(rig: CommandRig, verb: str = "start", **args: object) -> str:
    """Return the text of the end of a start that does not act."""
    rig.submit(verb, args=args)
    await asyncio.sleep(30.0)
    assert rig.sink.final().phase is Phase.UNCONFIRMED
    return rig.sink.final().text


def after_the_start(rig: CommandRig, then: Callable[[Request], Outcome | None]) -> None:
    """Let this say what becomes of requests after the start was written."""

    def rule(request: Request) -> Outcome | None:
        return then(request) if START in rig.line.writes and request != START else None

    rig.line.rules.append(rule)


@pytest.mark.parametrize("lost", range(1, MOST_TAKE_BACKS))
@virtually
async def test_run_0_is_written_again_while_it_is_lost(lost: int) -> None:
    rig = await hindered()
    after_the_start(
        rig, lambda request: Silent() if request.is_write and rig.line.writes.count(RUN_OFF) <= lost else None
    )

    assert TAKEN in await end_of(rig)

    assert rig.line.writes == [START, *[RUN_OFF] * (lost + 1)]


@virtually
async def test_a_lost_acknowledgement_is_made_up_for_by_what_is_read() -> None:
    rig = await hindered()

    def lose(request: Request) -> Outcome | None:
        if not request.is_write:
            return None
        rig.unit.answer(request)
        return Silent()

    after_the_start(rig, lose)

    assert TAKEN in await end_of(rig)


@pytest.mark.parametrize("lost", range(1, 5))
@virtually
async def test_a_reading_that_is_lost_just_then_does_not_leave_the_start_standing(lost: int) -> None:
    rig = await hindered()
    begun_s = asyncio.get_running_loop().time()
    left = [lost]

    def lose(request: Request) -> Outcome | None:
        is_time = asyncio.get_running_loop().time() > begun_s + 3.0
        if request.is_write or not is_time or not left[0]:
            return None
        left[0] -= 1
        return Silent()

    after_the_start(rig, lose)

    assert TAKEN in await end_of(rig)


@pytest.mark.parametrize("is_ignored", [False, True])
@virtually
async def test_in_local_mode_nothing_says_that_run_0_was_taken(*, is_ignored: bool) -> None:
    rig = await hindered()
    take = rig.unit.on_write

    def to_local(request: Request) -> None:
        if request == START or not is_ignored:
            take(request)
        rig.unit.holding[VB01] = READY & ~REMOTE

    rig.unit.on_write = to_local

    text = await end_of(rig)

    assert NOT_TAKEN in text
    assert TAKEN not in text


@virtually
async def test_a_motor_that_is_started_meanwhile_is_left_alone() -> None:
    rig = await hindered()

    def lose_and_start(request: Request) -> Outcome | None:
        if not request.is_write:
            return None
        rig.unit.holding[VB01] = AT_SPEED
        return Silent()

    after_the_start(rig, lose_and_start)

    assert NOT_TAKEN in await end_of(rig)
    assert rig.line.writes == [START, RUN_OFF]


@pytest.mark.parametrize(
    ("code", "writes"), [("identity_mismatch", [START]), ("no_answer", [START, RUN_OFF])]
)
@virtually
async def test_another_device_is_left_alone_but_lost_replies_say_nothing_of_who_is_there(
    code: str, writes: list[Request]
) -> None:
    rig = await hindered()

    async def prove(*, lane: object) -> None:
        if START in rig.line.writes:
            raise CommandError(code, "as it seems")

    rig.telemetry.prove = prove  # type: ignore[method-assign]

    assert (NOT_TAKEN if code == "identity_mismatch" else TAKEN) in await end_of(rig)
    assert rig.line.writes == writes


@virtually
async def test_nothing_is_written_on_a_reading_that_has_grown_old() -> None:
    rig = await hindered()

    async def slow(*, lane: object) -> None:
        if START in rig.line.writes:
            await asyncio.sleep(2.5)

    rig.telemetry.prove = slow  # type: ignore[method-assign]

    assert NOT_TAKEN in await end_of(rig)
    assert rig.line.writes == [START]


@virtually
async def test_a_start_that_cannot_be_taken_back_since_nothing_is_read_is_said_to_stand_perhaps() -> None:
    rig = await hindered()
    after_the_start(rig, lambda _: Silent("no reply"))

    assert MAY_STAND in await end_of(rig)
    assert rig.line.writes == [START]


@virtually
async def test_a_general_disable_of_an_ssw900_stands_when_a_start_is_taken_back() -> None:
    """Its supervision of the line writes bits of the command word, too (ssw900 C8.2.5.2)."""
    rig = await ready("ssw900")
    enabled = rig.unit.holding[STATUS]

    def disable(request: Request) -> Outcome | None:
        if isinstance(request, ReadHoldingRegisters):
            rig.unit.holding[STATUS] = enabled & ~0x0002
        return None

    rig.line.rules.append(lambda request: disable(request) if rig.line.writes else None)

    assert TAKEN in await end_of(rig)

    assert rig.line.writes == [WriteRegister(WORD, 0x0013), WriteRegister(WORD, 0x0010)]
