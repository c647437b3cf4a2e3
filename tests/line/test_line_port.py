"""A line's port that goes and comes back."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Iterable

import pytest

from gateway.line.line import REOPEN_MAX_S, REOPEN_MIN_S
from gateway.line.rtu.outcome import Answered, Outcome, Silent
from gateway.line.scheduler.requests import Priority
from gateway.modbus.writes import WriteRegister
from tests.line.fakes import TIMING, Answer, FakeConnection, LineRig, Said, Units, no_reply, poll
from tests.line.served import NO_PORT, READ, WRITE
from tests.virtual_time import run_virtually


def test_a_port_that_cannot_be_opened_is_reported_once_per_reason_and_tried_ever_less_often() -> None:
    rig = LineRig(Units({1}), [poll("a")])
    rig.opener.failure = "no such port"

    async def scenario() -> Outcome:
        async with rig:
            outcome = await rig.transact(1, WRITE, Priority.STOP)
            await asyncio.sleep(30.0)
            rig.opener.failure = "busy"
            await asyncio.sleep(20.0)
            rig.opener.failure = None
            await asyncio.sleep(20.0)
            return outcome

    assert run_virtually(scenario()) == NO_PORT
    assert [event[1:] for event in rig.listener.ports] == [
        (False, "port fake: no such port"),
        (False, "port fake: busy"),
        (True, "open"),
    ]
    tried_s = rig.opener.tried_s
    gaps_s = [later - earlier for earlier, later in itertools.pairwise(tried_s[:7])]
    assert gaps_s == pytest.approx([0.5, 1.0, 2.0, 2.0, 2.0, 2.0])
    assert REOPEN_MIN_S == 0.5
    assert REOPEN_MAX_S == 2.0
    assert isinstance(rig.listener.outcomes("a")[0], Answered)


def test_a_lost_port_ends_all_jobs_and_is_opened_again() -> None:
    def answer(frame: bytes) -> Iterable[Said]:
        return no_reply(frame) if frame[1] == 6 else Units({1})(frame)

    rig = LineRig(answer, [])

    async def scenario() -> list[Outcome]:
        async with rig:
            jobs = [asyncio.create_task(rig.transact(1, WRITE)) for _ in range(2)]
            await asyncio.sleep(0.010)  # the first is on the wire
            rig.port.hang_up()
            outcomes = await asyncio.gather(*jobs)
            outcomes.append(await rig.transact(1, WRITE))
            await asyncio.sleep(1.0)
            outcomes.append(await rig.transact(1, READ))
            return outcomes

    outcomes = run_virtually(scenario())

    assert outcomes[:3] == [Silent("port lost", is_sent=True), NO_PORT, NO_PORT]
    assert isinstance(outcomes[3], Answered)
    assert [event[1:] for event in rig.listener.ports] == [
        (True, "open"),
        (False, "port fake: lost"),
        (True, "open"),
    ]
    assert rig.opener.ports[0].is_closed
    assert rig.opener.tried_s[1] - rig.listener.ports[1][0] == pytest.approx(REOPEN_MIN_S)
    assert [event[2] for event in rig.listener.units] == [True]  # a lost port is no unit's fault


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


STOP = WriteRegister(5003, 0)


def silent_to_writes(frame: bytes) -> Iterable[Said]:
    return no_reply(frame) if frame[1] == 6 else Units({1})(frame)


def connection_rig(answer: Answer = silent_to_writes) -> LineRig:
    """Return a line behind a connection that may deliver late."""
    rig = LineRig(answer, [poll("a")])
    rig.opener.make_port = lambda: FakeConnection(answer, TIMING)
    return rig


@pytest.mark.parametrize(
    ("lane", "resets"),
    [
        (Priority.COMMAND, 1),
        (Priority.PARAMETERS, 1),
        (Priority.READ_BACK, 1),
        (Priority.STOP, 0),
        (Priority.FOLLOW_UP, 0),  # a stop's repeat
    ],
)
def test_a_write_without_an_answer_resets_a_connection_at_once_but_a_stop_does_not(
    lane: Priority, resets: int
) -> None:
    rig = connection_rig()

    async def scenario() -> tuple[Outcome, float, Outcome]:
        async with rig:
            await asyncio.sleep(0.5)
            outcome = await rig.transact(1, WRITE, lane)
            ended_s = asyncio.get_running_loop().time()
            await asyncio.sleep(0.001)
            return outcome, ended_s, await rig.transact(1, READ)

    outcome, ended_s, next_one = run_virtually(scenario())

    assert outcome == Silent()
    assert isinstance(next_one, Answered)  # on the new connection, without a pause
    assert len(rig.opener.ports) == 1 + resets
    if resets:
        assert rig.opener.ports[0].closed_s == pytest.approx(ended_s)
    assert [event[1:] for event in rig.listener.ports] == [(True, "open")]  # not worth an event
    assert [unit[2] for unit in rig.listener.units] == [True] * (1 + resets)


def test_what_waits_behind_a_write_that_resets_the_connection_goes_out_on_the_next_one() -> None:
    rig = connection_rig()

    async def scenario() -> list[Outcome]:
        async with rig:
            jobs = [rig.transact(1, WRITE), rig.transact(1, READ), rig.transact(1, STOP, Priority.STOP)]
            return list(await asyncio.gather(*jobs))

    written, read, _ = run_virtually(scenario())

    assert written == Silent()
    assert isinstance(read, Answered)


def test_a_line_that_ends_while_it_reopens_leaves_no_job_waiting() -> None:
    rig = connection_rig()

    async def scenario() -> list[Outcome]:
        async with rig:
            rig.opener.takes_s = 60.0
            jobs = [asyncio.create_task(rig.transact(1, each)) for each in (WRITE, READ)]
            await jobs[0]
            await asyncio.sleep(0.01)
        return [await job for job in jobs]

    assert run_virtually(scenario()) == [Silent(), NO_PORT]
