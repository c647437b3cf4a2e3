"""Which poll comes next: rhythm, due times, changes."""

from __future__ import annotations

import random
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.line.rtu.outcome import Answered, Silent
from gateway.line.scheduler.line_time import FREE_PERIOD_S
from gateway.line.scheduler.requests import Priority, Verdict
from tests.line.fakes import poll
from tests.line.ideal_line import IdealLine
from tests.line.scheduled import ANSWERED, begun, gaps, job, key_of, take


def test_a_poll_that_is_expedited_while_it_is_under_way_comes_once_more() -> None:
    scheduler = begun(poll("a", every_s=10.0))
    slot = scheduler.pick(0.0)
    assert slot is not None

    scheduler.polls.expedite("a", 0.01)
    scheduler.record(slot, ANSWERED, 0.02)

    assert scheduler.next_due_s() == 0.02


def test_a_removed_poll_is_not_asked_and_its_answer_under_way_not_reported() -> None:
    scheduler = begun(poll("a"), poll("b"))
    slot = scheduler.pick(0.0)
    assert slot is not None

    scheduler.polls.remove("a")
    scheduler.polls.add(poll("a", every_s=5.0), 0.0)

    assert scheduler.record(slot, ANSWERED, 0.0) == Verdict(is_final=False, is_answering=True)
    assert [key_of(take(scheduler, 0.0)) for _ in range(3)] == ["b", "a", None]


def test_all_periods_are_stretched_by_one_factor_when_the_line_is_over_full() -> None:
    scheduler = begun(poll("a", every_s=1.0), poll("b", every_s=2.0), poll("c", every_s=4.0))
    seen = Counter[str | None]()
    now_s = 0.0

    while now_s < 2000.0:
        slot = scheduler.pick(now_s)
        now_s = now_s + 1.0 if slot is not None else scheduler.next_due_s()
        if slot is not None:
            scheduler.record(slot, ANSWERED, now_s)
            seen[key_of(slot)] += 1

    assert scheduler.polls.stretch == pytest.approx(1.75)
    assert seen["a"] == pytest.approx(2 * seen["b"], rel=0.1)
    assert seen["b"] == pytest.approx(2 * seen["c"], rel=0.1)
    assert seen.total() == 2000  # no time is left idle


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


def test_a_port_that_is_opened_again_stretches_nothing_by_itself() -> None:
    line = IdealLine([poll(str(unit), unit, 0.3) for unit in range(1, 9)], lambda slot: 0.03)
    line.run(5.0)
    line.now_s += 1.0  # without a port
    line.scheduler.polls.begin(line.now_s)

    stretched = []
    while line.now_s < 8.0:
        line.step()
        stretched.append(line.scheduler.polls.stretch)

    assert max(stretched) == 1.0


def test_periods_are_as_they_were_when_an_offline_starter_or_a_poll_no_longer_costs_anything() -> None:
    dead = set[int]()
    polls = [poll(str(unit), unit, 0.3) for unit in range(1, 16)]
    line = IdealLine(
        polls,
        lambda slot: 0.03,
        lambda slot, at_s: Silent() if slot.unit in dead else Answered((), at_s, 0.0),
    )
    line.run(20.0)
    assert line.scheduler.polls.stretch == pytest.approx(1.5)

    line.scheduler.polls.set_every("15", 3.0, line.now_s)
    line.run(40.0)
    assert line.scheduler.polls.stretch == pytest.approx(1.41)
    line.scheduler.polls.remove("15")
    dead.update(range(9, 15))
    line.run(60.0)

    assert line.scheduler.polls.stretch == 1.0


def test_wrong_keys_are_refused() -> None:
    scheduler = begun(poll("a"))

    with pytest.raises(ValueError, match="'a' already"):
        scheduler.polls.add(poll("a"), 0.0)
    with pytest.raises(KeyError):
        scheduler.polls.remove("b")
    with pytest.raises(KeyError):
        scheduler.polls.expedite("b", 0.0)
    with pytest.raises(KeyError):
        scheduler.polls.set_every("b", 1.0, 0.0)


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
        slot = take(scheduler, now_s)
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


def test_a_process_that_stands_still_while_its_first_poll_is_answered_leaves_none_unasked_for_long() -> None:
    polls = [
        poll(f"{unit}/{every_s}", unit=unit, every_s=every_s)
        for unit in range(1, 21)
        for every_s in (0.25, 10.0)
    ]
    scheduler, now_s = begun(*polls), 0.0
    asked_s: dict[str | None, list[float]] = {}
    for at in range(6_000):
        slot = scheduler.pick(now_s)
        if slot is None:
            now_s = scheduler.next_due_s()
            continue
        asked_s.setdefault(key_of(slot), []).append(now_s)
        now_s += 5.0 if at == 2 else 0.06
        scheduler.record(slot, ANSWERED, now_s)

    assert len(asked_s) == len(polls)
    assert max(max(gaps(times_s)) for times_s in asked_s.values()) < 70.0  # 50 s where none stands still
