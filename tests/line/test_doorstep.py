"""A request holds back a moment for what has arrived and may be a stop."""

from __future__ import annotations

import asyncio

import pytest

from gateway.line.scheduler.requests import Priority
from gateway.line.stop_hold import CREDIT_S, GRACE_S, LOOK_EVERY_S, SHARE, StopHold
from gateway.modbus.writes import WriteRegister
from tests.line.fakes import DELAY_S, TIMING, LineRig, Units, poll
from tests.virtual_time import run_virtually

START = WriteRegister(5003, 1)
STOP = WriteRegister(5003, 0)
REPLY_END_S = TIMING.wire_s(8 + 25) + DELAY_S
ROUND_S = REPLY_END_S + TIMING.silence_s
SOON_S = 0.0002  # the next request is due, and has been chosen


class Arrivals:
    """What has arrived and is being read, until it is done."""

    def __init__(self) -> None:
        self.is_there = False

    def __call__(self) -> bool:
        return self.is_there


def written(rig: LineRig) -> list[int]:
    return [frame[1] for _, frame in rig.port.sent]


async def let_arrive(arrivals: Arrivals, rig: LineRig, taken_s: float) -> None:
    """Let something arrive right before the second request, and let so much time pass after that was due."""
    while not rig.port.sent:  # noqa: ASYNC110 - in virtual time
        await asyncio.sleep(0.0001)
    await asyncio.sleep(sent_s(rig)[0] + ROUND_S - SOON_S - asyncio.get_running_loop().time())
    arrivals.is_there = True
    await asyncio.sleep(SOON_S + taken_s)


def sent_s(rig: LineRig) -> list[float]:
    return [at_s for at_s, _ in rig.port.sent]


@pytest.mark.parametrize(
    ("request_", "lane", "taken_s"),
    [
        (STOP, Priority.STOP, 0.0004),
        (STOP, Priority.STOP, GRACE_S - LOOK_EVERY_S),
        (START, Priority.COMMAND, 0.0008),
    ],
)
def test_a_stop_that_is_still_being_read_when_the_silence_ends_goes_before_the_poll(
    request_: WriteRegister, lane: Priority, taken_s: float
) -> None:
    arrivals = Arrivals()
    rig = LineRig(Units({1}), [poll("a", every_s=0.0)], has_arrived=arrivals)

    async def scenario() -> None:
        async with rig:
            await let_arrive(arrivals, rig, taken_s)
            answered = asyncio.create_task(rig.transact(1, request_, lane))
            await asyncio.sleep(0.0)
            arrivals.is_there = False
            await answered

    run_virtually(scenario())

    assert written(rig)[:2] == [3, 6]


def test_a_stop_goes_as_soon_as_it_is_there_although_more_keeps_arriving() -> None:
    arrivals = Arrivals()
    rig = LineRig(Units({1}), [poll("a", every_s=0.0)], has_arrived=arrivals)

    async def scenario() -> float:
        async with rig:
            await let_arrive(arrivals, rig, 0.0005)
            asked_s = asyncio.get_running_loop().time()
            await rig.transact(1, STOP, Priority.STOP)
            return asked_s

    asked_s = run_virtually(scenario())

    assert written(rig)[:2] == [3, 6]
    assert sent_s(rig)[1] == pytest.approx(asked_s, abs=0.0001)


def test_what_turns_out_to_be_no_command_costs_the_poll_no_more_than_its_reading() -> None:
    arrivals = Arrivals()
    rig = LineRig(Units({1}), [poll("a", every_s=0.0)], has_arrived=arrivals)

    async def scenario() -> None:
        async with rig:
            await let_arrive(arrivals, rig, 0.0005)
            arrivals.is_there = False
            await asyncio.sleep(ROUND_S)

    run_virtually(scenario())

    times_s = sent_s(rig)
    assert 0.0004 < times_s[1] - times_s[0] - ROUND_S < 0.0005 + 1.5 * LOOK_EVERY_S


def test_what_never_ends_to_arrive_takes_a_hundredth_of_the_line_at_most() -> None:
    polls = [poll("a", every_s=0.0)]

    def rounds(*, is_there: bool) -> int:
        rig = LineRig(Units({1}), polls, has_arrived=lambda: is_there)

        async def scenario() -> None:
            async with rig:
                await asyncio.sleep(20.0)

        run_virtually(scenario())
        return len(rig.port.sent)

    assert rounds(is_there=True) > rounds(is_there=False) * (1 - SHARE) - 2


def test_a_request_is_held_back_for_three_milliseconds_at_most() -> None:
    doorstep = StopHold(lambda: True)
    assert doorstep.is_worth_waiting(10.0)
    assert doorstep.is_worth_waiting(10.0 + GRACE_S - 0.0001, began_s=10.0)
    assert not doorstep.is_worth_waiting(10.0 + GRACE_S, began_s=10.0)


def test_the_right_to_hold_requests_back_is_used_up_and_comes_again() -> None:
    doorstep = StopHold(lambda: True)
    assert doorstep.is_worth_waiting(10.0)
    doorstep.waited(10.0, 10.0 + 1.1 * CREDIT_S)

    assert not doorstep.is_worth_waiting(10.0)
    assert doorstep.is_worth_waiting(10.0 + GRACE_S / SHARE)
