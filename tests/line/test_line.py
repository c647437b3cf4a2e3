"""A line as it is served: what is sent when, while jobs come and go and the port is lost."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable, Coroutine
from itertools import pairwise
from typing import Any

import pytest

from gateway.line.line import REOPEN_MAX_S, REOPEN_MIN_S
from gateway.line.rtu.transaction import TOO_LATE, Answered, Outcome, Silent
from gateway.line.scheduler.requests import Poll, Priority
from gateway.modbus.writes import WriteRegister
from tests.line.line_rig import DELAY_S, READ, TIMING, LineRig, Wires, poll
from tests.virtual_time import run_virtually

WRITE, STOP = WriteRegister(314, 9), WriteRegister(314, 0)
REPLY_S = DELAY_S + TIMING.wire_s(8 + 9)  # from the beginning of a poll to the end of its reply
ONE_S = REPLY_S + TIMING.silence_s
PORT_LOST, PORT_CLOSED = Silent("port lost"), Silent("port closed", is_sent=False)


def served(
    scenario: Callable[[LineRig], Coroutine[Any, Any, Any]], *polls: Poll, is_plugged: bool = True
) -> tuple[Any, LineRig]:
    """Play a scenario on a line with one unit; return its outcome, and the rig."""

    async def main() -> tuple[Any, LineRig]:
        wires = Wires()
        wires.bus.is_plugged_in = is_plugged
        async with LineRig(wires, *polls) as rig:
            return await scenario(rig), rig

    return run_virtually(main())


async def into_a_silence(rig: LineRig) -> None:
    """Sleep until the first reply has just ended: the next request is chosen, and not yet sent."""
    while not rig.wires.sent:  # noqa: ASYNC110 - in virtual time
        await asyncio.sleep(0.0001)
    at_s = rig.wires.sent[0][0] + REPLY_S + TIMING.silence_s / 2
    await asyncio.sleep(at_s - asyncio.get_running_loop().time())


def functions(rig: LineRig) -> list[int]:
    return [pdu[0] for _, pdu in rig.wires.sent]


@pytest.mark.parametrize(("request_", "lane"), [(STOP, Priority.STOP), (WRITE, Priority.COMMAND)])
def test_what_comes_in_the_silence_goes_before_the_poll_that_was_chosen(
    request_: WriteRegister, lane: Priority
) -> None:
    async def scenario(rig: LineRig) -> None:
        await into_a_silence(rig)
        await rig.transact(1, request_, lane)

    _, rig = served(scenario, poll("a", every_s=0.0))

    assert functions(rig)[:2] == [3, 6]


def test_a_command_that_is_cancelled_or_too_late_before_its_slot_is_never_sent() -> None:
    async def scenario(rig: LineRig) -> Outcome:
        await into_a_silence(rig)
        cancelled = rig.transact(1, WRITE)
        too_late = rig.transact(1, WRITE, until_s=asyncio.get_running_loop().time())
        await asyncio.sleep(TIMING.silence_s / 4)
        cancelled.cancel()
        await asyncio.sleep(0.2)
        assert isinstance(
            await rig.transact(1, STOP, until_s=asyncio.get_running_loop().time() + ONE_S), Answered
        )
        return await too_late

    outcome, rig = served(scenario, poll("a", every_s=0.0))

    assert outcome == Silent(TOO_LATE, is_sent=False)
    assert [pdu for _, pdu in rig.wires.sent if pdu[0] == 6] == [STOP.encode()]


@pytest.mark.parametrize("after_s", [random.Random(5).uniform(0.0, 0.1) for _ in range(20)])
def test_a_line_that_ends_lets_the_transaction_under_way_end_and_sends_no_more(after_s: float) -> None:
    async def scenario(rig: LineRig) -> float:
        await asyncio.sleep(after_s)
        ending_s = asyncio.get_running_loop().time()
        await rig.host.stop()
        assert asyncio.get_running_loop().time() <= ending_s + ONE_S
        await asyncio.sleep(1.0)
        return ending_s

    ending_s, rig = served(scenario, poll("a", every_s=0.0))

    assert all(at_s <= ending_s for at_s, _ in rig.wires.sent)
    assert rig.polls == len(rig.wires.sent)


def test_what_waits_when_the_port_is_lost_says_whether_it_was_sent() -> None:
    async def scenario(rig: LineRig) -> list[Outcome]:
        rig.wires.silent("u1")
        jobs = [rig.transact(1, WRITE) for _ in range(2)]
        await asyncio.sleep(0.010)  # the first is on the wire
        rig.wires.unplug()
        return await asyncio.gather(*jobs)

    assert served(scenario)[0] == [PORT_LOST, PORT_CLOSED]


def test_a_port_that_cannot_be_opened_is_reported_once_and_tried_ever_less_often() -> None:
    async def scenario(rig: LineRig) -> None:
        await asyncio.sleep(30.0)
        rig.wires.plug()
        await asyncio.sleep(20.0)

    _, rig = served(scenario, poll("a"), is_plugged=False)

    assert [is_open for _, is_open, _ in rig.ports] == [False, True]
    gaps_s = [later - earlier for earlier, later in pairwise(rig.wires.tried_s[:5])]
    assert gaps_s == pytest.approx([REOPEN_MIN_S, 2 * REOPEN_MIN_S, REOPEN_MAX_S, REOPEN_MAX_S])


def test_a_flapping_port_is_tried_ever_less_often_and_one_that_lasted_at_once() -> None:
    async def scenario(rig: LineRig) -> None:
        await rig.until("pumps port True")
        for lasts_s in (1.0, 1.0, 1.0, 60.0):
            await asyncio.sleep(lasts_s)
            rig.wires.unplug(for_s=0.1)
            await rig.until("pumps port False")
            await rig.until("pumps port True")

    _, rig = served(scenario, poll("a", every_s=0.1))

    lost_s = [at_s for at_s, is_open, _ in rig.ports if not is_open]
    gaps_s = [tried - lost for lost, tried in zip(lost_s, rig.wires.tried_s[1:], strict=True)]
    assert gaps_s == pytest.approx([0.5, 1.0, 2.0, 0.5])


@pytest.mark.parametrize(
    ("lane", "is_back", "sent"),
    [
        (Priority.COMMAND, True, ["04", "06"]),  # a fence first: its answer proves that the unit is in step
        (Priority.COMMAND, False, ["04"]),  # not answered: the write is not sent
        (Priority.STOP, True, ["06"]),
        (Priority.STOP, False, ["06"]),
    ],
)
def test_a_write_goes_out_in_step_and_a_stop_at_once(lane: Priority, is_back: bool, sent: list[str]) -> None:
    async def scenario(rig: LineRig) -> Outcome:
        rig.wires.silent("u1")
        assert await rig.transact(1, READ) == Silent()
        if is_back:
            rig.wires.heal("u1")
        return await rig.transact(1, WRITE, lane)

    outcome, rig = served(scenario)

    assert [pdu[:1].hex() for _, pdu in rig.wires.sent[1:]] == sent
    if sent == ["04"]:
        assert outcome == Silent(TOO_LATE, is_sent=False)
    else:
        assert isinstance(outcome, Answered) is is_back
