"""On a line where somebody sends without end a stop goes out all the same; nothing else does."""

from __future__ import annotations

import asyncio

import pytest

from gateway.line.rtu.outcome import Garbled, Outcome, Silent
from gateway.line.rtu.transaction import BABBLE_LIMIT_S, STOP_PATIENCE_S
from gateway.line.scheduler.requests import Priority
from gateway.line.service import GAP_WITHIN_S
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteRegister
from tests.line.fakes import TIMING, FakePort, LineRig, Said, Units, poll
from tests.virtual_time import run_virtually

STOP = WriteRegister(5003, 0)
READ = ReadHoldingRegisters(0, 2)
WITHIN_S = STOP_PATIENCE_S + GAP_WITHIN_S + 0.05


def babble(port: FakePort, seconds: float = 3.0) -> None:
    """Let somebody send one byte after the other for so long."""
    port.may_be_disturbed = True
    count = int(seconds / TIMING.character_s)
    port.say(Said(b"\x55" * count, 0.0, in_chunks_of=1))


async def stop(rig: LineRig, lane: Priority = Priority.STOP) -> tuple[float, Outcome]:
    """Stop a motor; return after what time its frame went out, and what became of it."""
    asked_s = asyncio.get_running_loop().time()
    outcome = await rig.transact(1, STOP, lane)
    frames_s = [at_s for at_s, frame in rig.port.sent if frame[1] == 6 and at_s >= asked_s]
    return frames_s[0] - asked_s, outcome


@pytest.mark.parametrize("after_s", [0.0, 0.4, 0.9])
@pytest.mark.parametrize("lane", [Priority.STOP, Priority.FOLLOW_UP])
def test_a_stop_goes_out_over_the_babble_after_a_bounded_wait_and_its_outcome_says_so(
    after_s: float, lane: Priority
) -> None:
    async def scenario() -> tuple[float, Outcome]:
        async with LineRig(Units({1}), [poll("a", every_s=0.0)]) as rig:
            await asyncio.sleep(1.0)
            babble(rig.port)
            await asyncio.sleep(0.05 + after_s)
            return await stop(rig, lane)

    waited_s, outcome = run_virtually(scenario())

    assert waited_s <= WITHIN_S
    assert isinstance(outcome, Garbled)
    assert outcome.is_sent
    assert outcome.is_over_babble


def test_a_stop_goes_out_between_two_frames_where_there_is_a_gap() -> None:
    gap_s = 2.5 * TIMING.character_s  # too short for a silence, too long for a pause inside a frame

    async def scenario() -> list[float]:
        async with LineRig(Units({1}), [poll("a", every_s=10.0)]) as rig:
            await asyncio.sleep(1.0)
            rig.port.may_be_disturbed = True
            for number in range(300):
                rig.port.say(Said(b"\x55" * 10, number * (TIMING.wire_s(10) + gap_s)))
            await asyncio.sleep(0.1)
            await stop(rig)
            sent_s = rig.port.sent[-1][0]
            return [sent_s, rig.port.last_byte_before(sent_s)]

    sent_s, last_byte_s = run_virtually(scenario())

    assert sent_s - last_byte_s >= 1.5 * TIMING.character_s


@pytest.mark.parametrize(
    ("request_", "lane"), [(READ, Priority.FOLLOW_UP), (STOP, Priority.COMMAND), (READ, Priority.READ_BACK)]
)
def test_nothing_but_a_stop_is_sent_into_the_babble(request_: WriteRegister, lane: Priority) -> None:
    async def scenario() -> tuple[Outcome, int]:
        async with LineRig(Units({1}), [poll("a", every_s=0.0)]) as rig:
            await asyncio.sleep(1.0)
            babble(rig.port)
            await asyncio.sleep(0.05)
            before = len(rig.port.sent)
            outcome = await rig.transact(1, request_, lane)
            return outcome, len(rig.port.sent) - before

    outcome, sent = run_virtually(scenario())

    assert isinstance(outcome, Garbled)
    assert not outcome.is_sent
    assert sent == 0


def test_a_stop_that_comes_while_a_poll_waits_for_silence_does_not_wait_as_long() -> None:
    async def scenario() -> float:
        async with LineRig(Units({1}), [poll("a", every_s=0.0)]) as rig:
            await asyncio.sleep(1.0)
            babble(rig.port)
            await asyncio.sleep(0.7 * BABBLE_LIMIT_S)
            return (await stop(rig))[0]

    assert run_virtually(scenario()) <= GAP_WITHIN_S + 0.05


def test_a_port_that_is_lost_while_a_stop_waits_for_a_gap_ends_the_stop_unsent() -> None:
    async def scenario() -> Outcome:
        async with LineRig(Units({1}), [poll("a", every_s=0.0)]) as rig:
            await asyncio.sleep(1.0)
            babble(rig.port)
            await asyncio.sleep(0.05)
            waiting = asyncio.create_task(rig.transact(1, STOP, Priority.STOP))
            await asyncio.sleep(STOP_PATIENCE_S + GAP_WITHIN_S / 2)
            rig.port.hang_up()
            return await asyncio.wait_for(waiting, 5.0)

    assert run_virtually(scenario()) == Silent("port lost", is_sent=False)
