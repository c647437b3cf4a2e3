"""Jobs among polls: stops first, and what becomes of those that cannot be sent."""

from __future__ import annotations

import asyncio
import gc
import random
import weakref

import pytest

from gateway.line.rtu.outcome import TOO_LATE, Outcome, Silent
from gateway.line.scheduler.requests import Priority
from gateway.modbus.writes import WriteRegister
from tests.line.fakes import RESPONSE_TIME_S, TIMING, LineRig, Said, Units, no_reply, poll
from tests.line.served import NO_PORT, READ, WRITE
from tests.virtual_time import run_virtually


def test_a_stop_waits_for_one_transaction_at_the_most_and_goes_before_every_other_job() -> None:
    chance = random.Random(3)
    units = Units({1, 2})
    polls = [poll(str(unit), unit, 0.0, count=30) for unit in (1, 2, 3, 4)]
    rig = LineRig(units, polls)

    async def scenario() -> list[float]:
        waits_s = []
        loop = asyncio.get_running_loop()
        async with rig:
            for _ in range(100):
                await asyncio.sleep(chance.uniform(0.0, 0.3))
                others = [asyncio.create_task(rig.transact(2, WRITE)) for _ in range(3)]
                await asyncio.sleep(0)
                submitted_s = loop.time()
                stop = asyncio.create_task(rig.transact(1, WriteRegister(5003, 0), Priority.STOP))
                await asyncio.gather(stop, *others)
                waits_s.append(
                    next(
                        at
                        for at, it in rig.port.sent
                        if at >= submitted_s and it[4:6] == b"\0\0" and it[1] == 6
                    )
                    - submitted_s
                )
            return waits_s

    waits_s = run_virtually(scenario())

    latency_s = rig.line.statistics()["stop_latency_s"]
    assert latency_s["worst"] == pytest.approx(max(waits_s))
    assert latency_s["worst"] <= latency_s["computed"]


def test_a_job_whose_port_is_lost_before_it_is_sent_says_so() -> None:
    rig = LineRig(no_reply, [])

    async def scenario() -> Outcome:
        async with rig:
            await asyncio.sleep(1.0)
            rig.port.say(Said(b"\x55" * 20, 0.0, in_chunks_of=1))
            await asyncio.sleep(0.001)
            job = asyncio.create_task(rig.transact(1, WRITE))
            await asyncio.sleep(0.001)
            rig.port.hang_up()
            return await job

    outcome = run_virtually(scenario())

    assert isinstance(outcome, Silent)
    assert not outcome.is_sent


def test_cancellation_lets_the_transaction_under_way_end_and_sends_no_more() -> None:
    chance = random.Random(5)
    for _ in range(40):
        rig = LineRig(Units({1}), [poll("a", every_s=0.0)])

        async def scenario(rig: LineRig = rig) -> tuple[float, float]:
            async with rig:
                await asyncio.sleep(chance.uniform(0.0, 0.1))
                rig.task.cancel()
                cancelled_s = asyncio.get_running_loop().time()
                await asyncio.wait([rig.task])
                assert rig.task.cancelled()
                return cancelled_s, asyncio.get_running_loop().time()

        cancelled_s, ended_s = run_virtually(scenario())

        assert rig.port.is_closed
        assert rig.port.closed_s == ended_s
        assert all(at_s <= cancelled_s for at_s, _ in rig.port.sent)
        if rig.port.sent:
            last_s, last = rig.port.sent[-1]
            reply_s = last_s + TIMING.wire_s(len(last) + 25) + 0.005
            assert ended_s == pytest.approx(max(cancelled_s, reply_s))
            assert len(rig.listener.polls) == len(rig.port.sent)


def test_cancellation_ends_the_waiting_jobs() -> None:
    rig = LineRig(no_reply, [])

    async def scenario() -> list[Outcome]:
        async with rig:
            jobs = [asyncio.create_task(rig.transact(1, WRITE)) for _ in range(2)]
            await asyncio.sleep(0.01)
            rig.task.cancel()
            return await asyncio.gather(*jobs)

    assert run_virtually(scenario()) == [Silent(), NO_PORT]


def test_a_transaction_that_its_caller_gave_up_is_never_sent_unless_it_is_on_the_wire() -> None:
    rig = LineRig(Units({1}), [])

    async def scenario() -> None:
        async with rig:
            first, second = (asyncio.create_task(rig.transact(1, WRITE)) for _ in range(2))
            await asyncio.sleep(0.004)
            first.cancel()
            second.cancel()
            await asyncio.sleep(1.0)
            assert await rig.transact(1, READ)

    run_virtually(scenario())

    assert [frame[1] for _, frame in rig.port.sent] == [6, 3]


@pytest.mark.parametrize("is_cancelled", [False, True])
def test_a_job_that_has_ended_leaves_nothing_to_the_garbage_collection(is_cancelled: bool) -> None:
    rig = LineRig(Units({1}), [])

    async def scenario() -> object:
        async with rig:
            job = rig.client.transact(1, WRITE, response_time_s=RESPONSE_TIME_S, lane=Priority.COMMAND)
            if is_cancelled:
                job.cancel()
            await asyncio.wait([job])
            await asyncio.sleep(1.0)
            left = weakref.ref(job)
            del job
            return left()

    gc.collect()
    gc.disable()
    try:
        assert run_virtually(scenario()) is None
    finally:
        gc.enable()


def test_a_job_that_still_waits_when_its_time_is_over_ends_then_and_is_never_sent() -> None:
    rig = LineRig(no_reply, [])

    async def scenario() -> tuple[Outcome, float]:
        async with rig:
            loop = asyncio.get_running_loop()
            slow = rig.client.transact(1, READ, response_time_s=2.0, lane=Priority.COMMAND)
            await asyncio.sleep(0.1)
            until_s = loop.time() + 0.5
            outcome = await rig.client.transact(
                2, WRITE, response_time_s=RESPONSE_TIME_S, lane=Priority.COMMAND, until_s=until_s
            )
            after_s = loop.time() - until_s
            await slow
            await asyncio.sleep(1.0)
            return outcome, after_s

    outcome, after_s = run_virtually(scenario())

    assert outcome == Silent(TOO_LATE, is_sent=False)
    assert after_s < 0.01
    assert [frame[0] for _, frame in rig.port.sent] == [1]
