"""What is foretold of a line against what its plan does there, in virtual time.

Every reply comes as late as the line waits for it. What is tried for the age of a value: `adversary.py`.
"""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from gateway.line.capacity.forecast import forecast
from gateway.line.rtu.timeouts import ALLOWANCE_S, longest_s
from gateway.line.scheduler.requests import Job, Poll, Priority, Slot
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil
from tests.line.adversary import worst_of
from tests.line.ideal_line import READ, IdealLine, as_often_as_possible, cost_s, random_site

SEEDS = range(24)


def late_line(polls: list[Poll], timing: LineTiming) -> IdealLine:
    costs_s = {poll.key: cost_s(poll, timing, allowance_s=ALLOWANCE_S) for poll in polls}
    return IdealLine(polls, lambda turn: costs_s[turn.poll.key] if turn.poll else 0.0)


def hasten_all_but(line: IdealLine, victim: Poll) -> None:
    for poll in line.polls:
        if poll.key != victim.key:
            line.plan.hasten(poll.key, line.now_s)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_value_gets_older_than_foretold_and_what_is_foretold_is_at_most_a_quarter_above_the_worst(
    seed: int,
) -> None:
    timing, polls = random_site(seed)
    prospect = forecast(polls, timing)
    foretold = random.Random(seed).choice(prospect.polls)

    seen = worst_of(foretold.poll, polls, timing, prospect, seed)

    assert seen.excess_s <= 1e-6
    assert foretold.age_s / seen.age_s <= 1.25


def test_two_storms_a_period_apart_make_no_value_older_than_foretold() -> None:
    timing = LineTiming(19200, Framing.parse("8E1"))
    victim = Poll("victim", 1, READ, 3.0, 0.05)
    polls = [victim, *(Poll(f"{unit}", unit, READ, 2.0, 0.05) for unit in range(2, 10))]
    line = late_line(polls, timing)
    line.run(31.3)
    line.plan.hasten(victim.key, line.now_s)
    line.run(line.now_s + 5.0 - 1.01)
    hasten_all_but(line, victim)
    line.run(line.now_s + 1.01)
    line.gaps_s.clear()

    for _ in range(8):
        line.run(line.now_s + 2.6)
        hasten_all_but(line, victim)

    ages_s = {each.poll.key: each.age_s for each in forecast(polls, timing).polls}
    assert all(max(gaps) <= ages_s[key] for key, gaps in line.gaps_s.items())


def test_on_a_busy_line_no_storms_make_a_value_older_than_foretold_however_many_there_are() -> None:
    timing, polls = random_site(5)
    line = late_line(polls, timing)
    line.run(30.0)
    line.gaps_s.clear()
    chance = random.Random(5)

    while line.now_s < 300.0:
        line.run(line.now_s + chance.uniform(0.05, 1.0))
        hasten_all_but(line, chance.choice(polls))

    prospect = forecast(polls, timing)
    assert prospect.is_overloaded
    assert all(max(line.gaps_s[each.poll.key], default=0.0) <= each.age_s for each in prospect.polls)


def test_a_busy_line_that_is_left_alone_keeps_its_rhythm_all_the_same() -> None:
    timing = LineTiming(19200, Framing.parse("8E1"))
    polls = [
        Poll(f"{unit}/{block}", unit, ReadHoldingRegisters(0, count), every_s, 0.01)
        for unit in range(1, 13)
        for block, (count, every_s) in enumerate(((4, 1.0), (12, 1.0), (3, 10.0)))
    ]
    costs_s = {poll.key: cost_s(poll, timing) for poll in polls}
    line = IdealLine(polls, lambda turn: costs_s[turn.poll.key] if turn.poll else 0.0)
    line.run(60.0)
    line.gaps_s.clear()

    line.run(360.0)

    assert 0.6 < forecast(polls, timing).load < 0.8
    assert all(max(line.gaps_s[poll.key]) <= 1.01 * poll.every_s for poll in polls)


@pytest.mark.parametrize("seed", SEEDS[:12])
def test_what_is_foretold_of_a_value_without_a_period_is_met_and_not_far_from_it(seed: int) -> None:
    timing, polls = random_site(seed, units=(2, 4, 8))
    polls = as_often_as_possible(polls, {1, 3})
    prospect = forecast(polls, timing)
    foretold = random.Random(seed).choice([each for each in prospect.polls if not each.poll.every_s])

    seen = worst_of(foretold.poll, polls, timing, prospect, seed)

    assert seen.age_s <= foretold.age_s <= 1.4 * seen.age_s


@pytest.mark.parametrize("seed", SEEDS)
def test_storms_that_come_now_and_then_make_no_value_without_a_period_older_than_foretold(seed: int) -> None:
    timing, polls = random_site(seed, units=(2, 4, 8))
    polls = as_often_as_possible(polls, {1, 3})
    line = late_line(polls, timing)

    for _ in range(4):
        line.run(line.now_s + 30.0)
        hasten_all_but(line, polls[0])

    for each in forecast(polls, timing).polls:
        if not each.poll.every_s:
            assert max(line.gaps_s[each.poll.key]) <= each.age_s


@pytest.mark.parametrize("seed", SEEDS)
def test_on_average_every_poll_comes_as_often_as_foretold(seed: int) -> None:
    timing, polls = random_site(seed, units=(1, 2, 4, 8))
    if seed % 5 == 0:
        polls = as_often_as_possible(polls, {1, 2})
    prospect = forecast(polls, timing)
    costs_s = {each.poll.key: each.cost_s for each in prospect.polls}
    line = IdealLine(polls, lambda turn: costs_s[turn.poll.key] if turn.poll else 0.0)

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
    line = IdealLine(polls, lambda turn: costs_s[turn.poll.key] if turn.poll else 0.0)
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

    def take(turn: Slot) -> float:
        if turn.poll is None:
            waits_s.append(line.now_s + timing.silence_s - turn.since_s)
            return timing.silence_s
        line.plan.submit(stop(), line.now_s + chance.uniform(0.0, 0.1) * silent_s[turn.poll.key])
        return silent_s[turn.poll.key]

    line = IdealLine(polls, take)
    line.run(30.0)

    assert max(waits_s) <= prospect.stop_latency_s + timing.silence_s + 1e-9
    assert prospect.stop_latency_s <= 1.25 * max(waits_s)


def stop() -> Job:
    return Job(1, WriteCoil(0, True), 0.02, Priority.STOP, lambda outcome: None)
