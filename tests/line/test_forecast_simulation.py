"""What is forecast of a line against what its scheduler does there, in virtual time."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from gateway.line.capacity.forecast import forecast
from gateway.line.rtu.reply_times import longest_s
from gateway.line.scheduler.requests import Job, Poll, Priority, Slot
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil
from tests.line.ideal_line import IdealLine, as_often_as_possible, cost_s, random_site

SEEDS = range(24)


def test_a_busy_line_that_is_left_alone_keeps_its_rhythm_all_the_same() -> None:
    timing = LineTiming(19200, Framing.parse("8E1"))
    polls = [
        Poll(f"{unit}/{block}", unit, ReadHoldingRegisters(0, count), every_s, 0.01)
        for unit in range(1, 13)
        for block, (count, every_s) in enumerate(((4, 1.0), (12, 1.0), (3, 10.0)))
    ]
    costs_s = {poll.key: cost_s(poll, timing) for poll in polls}
    line = IdealLine(polls, lambda slot: costs_s[slot.poll.key] if slot.poll else 0.0)
    line.run(60.0)
    line.gaps_s.clear()

    line.run(360.0)

    assert 0.6 < forecast(polls, timing).load < 0.8
    late_s = 2 * max(costs_s.values())
    assert all(max(line.gaps_s[poll.key]) <= poll.every_s + late_s for poll in polls)


@pytest.mark.parametrize("seed", SEEDS)
def test_on_average_every_poll_comes_as_often_as_foretold(seed: int) -> None:
    timing, polls = random_site(seed, units=(1, 2, 4, 8))
    if seed % 5 == 0:
        polls = as_often_as_possible(polls, {1, 2})
    prospect = forecast(polls, timing)
    costs_s = {each.poll.key: each.cost_s for each in prospect.polls}
    line = IdealLine(polls, lambda slot: costs_s[slot.poll.key] if slot.poll else 0.0)

    line.run(60.0)
    line.gaps_s.clear()
    line.run(60.0 + 12 * max(each.period_s for each in prospect.polls))

    for each in prospect.polls:
        gaps_s = line.gaps_s[each.poll.key]
        assert sum(gaps_s) / len(gaps_s) == pytest.approx(each.period_s, rel=0.06)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_sweep_takes_as_long_as_foretold(seed: int) -> None:
    timing, polls = random_site(seed)
    polls = [replace(poll, every_s=0.05) for poll in polls]  # the line is always full
    prospect = forecast(polls, timing)
    costs_s = {each.poll.key: each.cost_s for each in prospect.polls}
    line = IdealLine(polls, lambda slot: costs_s[slot.poll.key] if slot.poll else 0.0)
    line.run(5.0 + 3 * prospect.sweep_s)
    line.gaps_s.clear()

    line.run(line.now_s + 20 * prospect.sweep_s)

    for gaps_s in line.gaps_s.values():
        assert sum(gaps_s) / len(gaps_s) == pytest.approx(max(prospect.sweep_s, 0.05), rel=0.02)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_stop_waits_no_longer_than_foretold_and_about_that_long_at_the_worst(seed: int) -> None:
    timing, polls = random_site(seed)
    prospect = forecast(polls, timing)
    silent_s = {
        poll.key: timing.silence_s + longest_s(poll.request, timing, response_time_s=poll.response_time_s)
        for poll in polls
    }
    chance = random.Random(seed)
    waits_s = []

    def take(slot: Slot) -> float:
        if slot.poll is None:
            waits_s.append(line.now_s + timing.silence_s - slot.since_s)
            return timing.silence_s
        line.scheduler.jobs.submit(stop(), line.now_s + chance.uniform(0.0, 0.1) * silent_s[slot.poll.key])
        return silent_s[slot.poll.key]

    line = IdealLine(polls, take)
    line.run(30.0)

    assert max(waits_s) <= prospect.stop_latency_s + timing.silence_s + 1e-9
    assert prospect.stop_latency_s <= 1.25 * max(waits_s)


def stop() -> Job:
    return Job(1, WriteCoil(0, True), 0.02, Priority.STOP, lambda outcome: None)
