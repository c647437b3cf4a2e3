"""A running line: what is sent when, while jobs come and go and the port is lost."""

from __future__ import annotations

import asyncio
import itertools
import random

import pytest

from gateway.line.line import REOPEN_MAX_S, REOPEN_MIN_S
from gateway.line.rtu.outcome import TOO_LATE, Answered, Outcome, Silent
from gateway.line.scheduler.requests import Job, Priority
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteRegister
from tests.line.fakes import DELAY_S, RESPONSE_TIME_S, TIMING, LineRig, Units, no_reply, poll
from tests.virtual_time import run_virtually

WRITE, STOP, READ = WriteRegister(5003, 1), WriteRegister(5003, 0), ReadHoldingRegisters(0, 10)
ONE_S = TIMING.wire_s(8 + 25) + DELAY_S + TIMING.silence_s


async def into_a_silence(rig: LineRig) -> None:
    """Sleep until a reply has just ended, so that the next request is chosen and not yet sent."""
    while not rig.port.sent:  # noqa: ASYNC110 - in virtual time
        await asyncio.sleep(0.0001)
    end_s = rig.port.sent[-1][0] + TIMING.wire_s(8 + 25) + DELAY_S
    await asyncio.sleep(end_s + TIMING.silence_s / 2 - asyncio.get_running_loop().time())


def functions(rig: LineRig) -> list[int]:
    return [frame[1] for _, frame in rig.port.sent]


@pytest.mark.parametrize(("request_", "lane"), [(STOP, Priority.STOP), (WRITE, Priority.COMMAND)])
def test_what_comes_in_the_silence_goes_before_the_poll_that_was_chosen(
    request_: WriteRegister, lane: Priority
) -> None:
    rig = LineRig(Units({1}), [poll("a", every_s=0.0)])

    async def scenario() -> None:
        async with rig:
            await into_a_silence(rig)
            await rig.transact(1, request_, lane)

    run_virtually(scenario())

    assert functions(rig)[:2] == [3, 6]


def test_a_chosen_command_that_is_given_up_before_it_is_sent_is_never_sent() -> None:
    rig = LineRig(Units({1}), [poll("a", every_s=0.0)])

    async def scenario() -> bool:
        job = Job(1, WRITE, RESPONSE_TIME_S, Priority.COMMAND, lambda outcome: None)
        async with rig:
            await into_a_silence(rig)
            rig.line.submit(job)
            await asyncio.sleep(TIMING.silence_s / 4)
            is_withdrawn = rig.line.withdraw(job)
            await asyncio.sleep(0.2)
            return is_withdrawn

    assert run_virtually(scenario())
    assert functions(rig).count(6) == 0


def test_a_job_whose_time_is_over_when_its_slot_comes_is_never_sent() -> None:
    rig = LineRig(Units({1}), [poll("a", every_s=0.0)])

    async def scenario() -> list[Outcome]:
        async with rig:
            await into_a_silence(rig)
            now_s = asyncio.get_running_loop().time()
            jobs = [
                rig.client.transact(
                    1, WRITE, until_s=until_s, response_time_s=RESPONSE_TIME_S, lane=Priority.COMMAND
                )
                for until_s in (now_s, now_s + ONE_S)
            ]
            return list(await asyncio.gather(*jobs))

    too_late, in_time = run_virtually(scenario())

    assert too_late == Silent(TOO_LATE, is_sent=False)
    assert isinstance(in_time, Answered)
    assert functions(rig).count(6) == 1


def test_a_line_that_ends_lets_the_transaction_under_way_end_and_sends_no_more() -> None:
    chance = random.Random(5)
    for _ in range(40):
        rig = LineRig(Units({1}), [poll("a", every_s=0.0)])

        async def scenario(rig: LineRig = rig) -> tuple[float, float]:
            async with rig:
                await asyncio.sleep(chance.uniform(0.0, 0.1))
                rig.task.cancel()
                cancelled_s = asyncio.get_running_loop().time()
                await asyncio.wait([rig.task])
                return cancelled_s, asyncio.get_running_loop().time()

        cancelled_s, ended_s = run_virtually(scenario())

        assert rig.port.closed_s == ended_s
        assert all(at_s <= cancelled_s for at_s, _ in rig.port.sent)
        assert len(rig.listener.polls) == len(rig.port.sent)


def test_what_waits_when_the_port_is_lost_says_whether_it_was_sent() -> None:
    rig = LineRig(no_reply, [])

    async def scenario() -> list[Outcome]:
        async with rig:
            jobs = [asyncio.create_task(rig.transact(1, WRITE)) for _ in range(2)]
            await asyncio.sleep(0.010)  # the first is on the wire
            rig.port.hang_up()
            return list(await asyncio.gather(*jobs))

    assert run_virtually(scenario()) == [
        Silent("port lost", is_sent=True),
        Silent("port closed", is_sent=False),
    ]


def test_a_port_that_cannot_be_opened_is_reported_once_per_reason_and_tried_ever_less_often() -> None:
    rig = LineRig(Units({1}), [poll("a")])
    rig.opener.failure = "no such port"

    async def scenario() -> None:
        async with rig:
            await asyncio.sleep(30.0)
            rig.opener.failure = None
            await asyncio.sleep(20.0)

    run_virtually(scenario())

    assert [event[1:] for event in rig.listener.ports] == [(False, "port fake: no such port"), (True, "open")]
    gaps_s = [later - earlier for earlier, later in itertools.pairwise(rig.opener.tried_s[:5])]
    assert gaps_s == pytest.approx([REOPEN_MIN_S, 2 * REOPEN_MIN_S, REOPEN_MAX_S, REOPEN_MAX_S])


def test_a_flapping_port_is_tried_ever_less_often_and_one_that_lasted_at_once() -> None:
    rig = LineRig(Units({1}), [poll("a", every_s=0.1)])

    async def scenario() -> None:
        async with rig:
            for lasts_s in (1.0, 1.0, 1.0, 60.0):
                await asyncio.sleep(lasts_s)
                rig.opener.opened.clear()
                rig.port.hang_up()
                await rig.opener.opened.wait()

    run_virtually(scenario())

    lost_s = [at_s for at_s, is_open, _ in rig.listener.ports if not is_open]
    gaps_s = [tried - lost for lost, tried in zip(lost_s, rig.opener.tried_s[1:], strict=True)]
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
    units = Units(set())

    async def scenario() -> tuple[Outcome, list[bytes]]:
        async with LineRig(units, ()) as rig:
            assert await rig.transact(1, ReadHoldingRegisters(0, 1)) == Silent()
            units.alive |= {1} if is_back else set()
            return await rig.transact(1, WriteRegister(3, 7), lane), [frame for _, frame in rig.port.sent]

    outcome, frames = run_virtually(scenario())

    assert [frame[1:2].hex() for frame in frames[1:]] == sent
    if sent == ["04"]:
        assert outcome == Silent(TOO_LATE, is_sent=False)
    else:
        assert isinstance(outcome, Answered) is is_back
