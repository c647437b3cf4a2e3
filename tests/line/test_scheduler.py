"""Which poll comes next: rhythm, due times, changes."""

from __future__ import annotations

import random
from collections import Counter
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.line.scheduler.line_time import FREE_PERIOD_S, JOBS_BURST_S
from gateway.line.scheduler.requests import Priority
from gateway.line.scheduler.scheduler import IN_ROW
from tests.line.ideal_line import ANSWERED, READ, IdealLine, begun, job
from tests.line.line_rig import poll


@pytest.mark.parametrize("every_s", [0.0, 1.0, 5.0])
@pytest.mark.parametrize("seed", [0])
def test_a_full_line_keeps_its_order_though_no_two_transactions_take_equally_long(
    every_s: float, seed: int
) -> None:
    chance = random.Random(seed)
    polls = [poll(str(unit), unit, every_s) for unit in range(1, 248)]
    line = IdealLine(polls, lambda slot: 0.026 + chance.expovariate(2000.0), seed=seed)
    line.run(14.0 if every_s else 0.0)  # its phases are left to chance first
    line.gaps_s.clear()

    line.run(60.0)

    round_s = 247 * line.now_s / len(line.slots)
    assert max(gap_s for each in line.gaps_s.values() for gap_s in each) <= 1.02 * round_s
    asked = [len(each) for each in line.gaps_s.values()]
    assert max(asked) - min(asked) <= 1


def test_in_the_first_minute_of_247_starters_none_waits_longer_than_two_sweeps() -> None:
    units, took_s = range(1, 248), 0.024
    polls = [poll(f"{unit}/{at}", unit, 1.0 if at < 2 else 10.0) for unit in units for at in range(7)]
    line = IdealLine(polls, lambda slot: took_s)
    for lane in (Priority.WATCHDOG, Priority.IDENTITY, Priority.PATROL, Priority.PATROL):
        for unit in units:
            line.scheduler.jobs.submit(job(lane, unit, READ), 0.0)

    line.run(60.0)

    assert {slot.poll is None for _, slot in line.slots[-100:]} == {True, False}  # jobs took half of it all
    for unit in units:
        times_s = [at_s for at_s, slot in line.slots if slot.unit == unit]
        longest_s = max(later - earlier for earlier, later in pairwise([*times_s, 60.0]))
        assert longest_s <= 2 * len(units) * took_s + JOBS_BURST_S


@settings(deadline=None)
@given(
    periods_s=st.lists(st.sampled_from([0.0, 0.05, 0.3, 1.0, 5.0]), min_size=1, max_size=12),
    jobs=st.lists(
        st.tuples(st.integers(0, 300), st.sampled_from([Priority.COMMAND, Priority.READ_BACK])), max_size=80
    ),
)
def test_no_poll_starves(periods_s: list[float], jobs: list[tuple[int, Priority]]) -> None:
    scheduler = begun(*(poll(str(at), unit=at + 1, every_s=every_s) for at, every_s in enumerate(periods_s)))
    by_step = Counter(jobs)
    last_s = dict.fromkeys(map(str, range(len(periods_s))), 0.0)
    longest_s = dict(last_s)
    most_stretched = 1.0

    for step in range(600):
        now_s = 0.03 * step
        for (at, lane), count in by_step.items():
            if at == step:
                for _ in range(count):
                    scheduler.jobs.submit(job(lane), now_s)
        slot = scheduler.pick(now_s)
        if slot is not None:
            scheduler.record(slot, ANSWERED, now_s)
        most_stretched = max(most_stretched, scheduler.polls.stretch)
        if slot is not None and slot.poll is not None:
            key = slot.poll.key
            longest_s[key] = max(longest_s[key], now_s - last_s[key])
            last_s[key] = now_s

    for key, gap_s in longest_s.items():
        bound_s = 2 * (periods_s[int(key)] or FREE_PERIOD_S) * most_stretched + 0.03 * (
            len(jobs) + len(periods_s) + 1
        )
        assert gap_s <= bound_s
        assert 600 * 0.03 - last_s[key] <= bound_s


def test_stops_repeats_and_watchdogs_that_are_due_alternate_and_let_a_poll_pass() -> None:
    units = range(1, 31)
    scheduler = begun(*(poll(str(unit), unit=unit, every_s=0.0) for unit in units))
    for unit in units:
        scheduler.polls.set_deadline(unit, 10.0)
    for _ in range(31):
        scheduler.record(scheduler.pick(0.0), ANSWERED, 0.0)
    for _ in range(40):
        scheduler.jobs.submit(job(Priority.FOLLOW_UP, unit=99, request=READ), 8.0)

    now_s, kinds = 8.0, ""
    for _ in range(40):
        slot = scheduler.pick(now_s)
        assert slot is not None
        kinds += "p" if not slot.jobs else "f"
        now_s += 0.05
        scheduler.record(slot, ANSWERED, now_s)

    assert kinds == ("f" * IN_ROW + "p" * (IN_ROW + 1)) * 2 + "f" * 6
