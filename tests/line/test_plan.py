"""Which poll comes next: rhythm, due times, changes."""

from __future__ import annotations

import random
from collections import Counter
from math import inf

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.line.rtu.outcome import Outcome, Silent
from gateway.line.scheduler.load import period_of
from gateway.line.scheduler.requests import Priority
from gateway.line.scheduler.scheduler import Verdict
from tests.line.fakes import poll
from tests.line.ideal_line import IdealLine
from tests.line.planned import ANSWERED, GARBLED, ask_times, begun, gaps, job, key_of, take


def test_an_empty_plan_has_nothing_to_do() -> None:
    plan = begun()

    assert plan.pick(0.0) is None
    assert plan.next_due_s() == inf


def test_polls_come_by_their_due_time() -> None:
    plan = begun(poll("a", every_s=1.0), poll("b", every_s=0.4))

    seen = [(at_s, key_of(take(plan, at_s))) for at_s in (0.0, 0.0, 0.39, 0.4, 0.8, 1.0, 1.21)]

    assert [key for _, key in seen] == ["a", "b", None, "b", "b", "a", "b"]


def test_a_poll_keeps_its_rhythm_though_each_turn_is_a_little_late() -> None:
    plan = begun(poll("a", every_s=1.0))

    for second in range(5):
        assert plan.pick(second - 1e-6) is None
        take(plan, second + 0.3)

    assert plan.next_due_s() == 5.0


def test_polls_without_a_period_take_turns() -> None:
    plan = begun(poll("a", every_s=0.0), poll("b", every_s=0.0), poll("c", every_s=0.0))

    assert [key_of(take(plan, 0.0)) for _ in range(6)] == ["a", "b", "c", "a", "b", "c"]


def test_a_line_that_is_too_slow_stretches_evenly_and_never_catches_up() -> None:
    plan = begun(*(poll(key, every_s=1.0) for key in "abcd"))

    keys = [key_of(take(plan, 0.5 * step)) for step in range(40)]

    assert keys == list("abcd") * 10


def test_a_change_of_a_units_state_is_told_once() -> None:
    plan = begun(poll("a", every_s=0.0))
    outcomes = [Silent(), ANSWERED, ANSWERED, Silent(), Silent(), Silent(), Silent(), ANSWERED]

    told = []
    for outcome in outcomes:
        now_s = max(plan.next_due_s(), 100.0 * len(told))
        turn = plan.pick(now_s)
        assert turn is not None
        told.append(plan.record(turn, outcome, now_s).is_answering)

    assert told == [None, True, None, None, None, None, False, True]  # two may be the line's fault


def test_a_shorter_period_takes_effect_at_once_and_a_longer_one_after_the_next_turn() -> None:
    plan = begun(poll("a", every_s=10.0))
    take(plan, 0.0)

    plan.polls.set_every("a", 0.2, 1.0)
    assert plan.next_due_s() == 1.2
    take(plan, 1.2)
    plan.polls.set_every("a", 10.0, 1.2)

    assert plan.next_due_s() == pytest.approx(1.4)
    take(plan, 1.4)
    assert plan.next_due_s() == pytest.approx(11.4)


def test_a_hastened_poll_is_due_now() -> None:
    plan = begun(poll("a", every_s=10.0))
    take(plan, 0.0)

    plan.polls.expedite("a", 3.0)

    assert plan.next_due_s() == 3.0
    take(plan, 3.0)
    assert plan.next_due_s() == 13.0


def test_a_poll_that_is_hastened_while_it_is_under_way_comes_once_more() -> None:
    plan = begun(poll("a", every_s=10.0))
    turn = plan.pick(0.0)
    assert turn is not None

    plan.polls.expedite("a", 0.01)
    plan.record(turn, ANSWERED, 0.02)

    assert plan.next_due_s() == 0.02


def test_a_removed_poll_is_not_asked_and_its_answer_under_way_not_told() -> None:
    plan = begun(poll("a"), poll("b"))
    turn = plan.pick(0.0)
    assert turn is not None

    plan.polls.remove("a")
    plan.polls.add(poll("a", every_s=5.0), 0.0)

    assert plan.record(turn, ANSWERED, 0.0) == Verdict(is_final=False, is_answering=True)
    assert [key_of(take(plan, 0.0)) for _ in range(3)] == ["b", "a", None]


def test_all_periods_are_stretched_by_one_factor_when_the_line_is_over_full() -> None:
    plan = begun(poll("a", every_s=1.0), poll("b", every_s=2.0), poll("c", every_s=4.0))
    seen = Counter[str | None]()
    now_s = 0.0

    while now_s < 2000.0:
        turn = plan.pick(now_s)
        now_s = now_s + 1.0 if turn is not None else plan.next_due_s()
        if turn is not None:
            plan.record(turn, ANSWERED, now_s)
            seen[key_of(turn)] += 1

    assert plan.polls.stretch == pytest.approx(1.75)
    assert seen["a"] == pytest.approx(2 * seen["b"], rel=0.1)
    assert seen["b"] == pytest.approx(2 * seen["c"], rel=0.1)
    assert seen.total() == 2000  # no time is left idle


def test_a_poll_may_get_and_lose_its_period() -> None:
    plan = begun(poll("a", every_s=0.0), poll("b", every_s=0.0))
    take(plan, 0.0)

    plan.polls.set_every("a", 5.0, 0.0)
    assert [key_of(take(plan, 0.0)) for _ in range(4)] == ["b", "a", "b", "b"]
    plan.polls.set_every("a", 0.0, 1.0)

    assert {key_of(take(plan, 1.0)), key_of(take(plan, 1.0))} == {"a", "b"}


def test_a_full_line_asks_all_in_one_order_from_the_first_round_on() -> None:
    line = IdealLine([poll(str(unit), unit, 0.0) for unit in range(1, 248)], lambda turn: 0.025)

    line.run(25.0)

    gaps_s = [gap_s for each in line.gaps_s.values() for gap_s in each]
    assert max(gaps_s) <= 1.02 * 247 * 0.025


def test_wrong_keys_are_refused() -> None:
    plan = begun(poll("a"))

    with pytest.raises(ValueError, match="'a' already"):
        plan.polls.add(poll("a"), 0.0)
    with pytest.raises(KeyError):
        plan.polls.remove("b")
    with pytest.raises(KeyError):
        plan.polls.expedite("b", 0.0)
    with pytest.raises(KeyError):
        plan.polls.set_every("b", 1.0, 0.0)


@settings(deadline=None)
@given(
    periods_s=st.lists(st.sampled_from([0.0, 0.05, 0.3, 1.0, 5.0]), min_size=1, max_size=12),
    jobs=st.lists(
        st.tuples(st.integers(0, 300), st.sampled_from([Priority.COMMAND, Priority.READ_BACK])), max_size=80
    ),
)
def test_no_poll_starves(periods_s: list[float], jobs: list[tuple[int, Priority]]) -> None:
    plan = begun(*(poll(str(at), unit=at + 1, every_s=every_s) for at, every_s in enumerate(periods_s)))
    by_step = Counter(jobs)
    last_s = dict.fromkeys(map(str, range(len(periods_s))), 0.0)
    longest_s = dict(last_s)
    most_stretched = 1.0

    for step in range(600):
        now_s = 0.03 * step
        for (at, lane), count in by_step.items():
            if at == step:
                for _ in range(count):
                    plan.jobs.submit(job(lane), now_s)
        turn = take(plan, now_s)
        most_stretched = max(most_stretched, plan.polls.stretch)
        if turn is not None and turn.poll is not None:
            key = turn.poll.key
            longest_s[key] = max(longest_s[key], now_s - last_s[key])
            last_s[key] = now_s

    for key, gap_s in longest_s.items():
        bound_s = 2 * period_of(periods_s[int(key)]) * most_stretched + 0.03 * (
            len(jobs) + len(periods_s) + 1
        )
        assert gap_s <= bound_s
        assert 600 * 0.03 - last_s[key] <= bound_s


@given(outcomes=st.lists(st.sampled_from([ANSWERED, GARBLED, Silent()]), max_size=60))
def test_a_unit_is_asked_for_ever_whatever_it_answers(outcomes: list[Outcome]) -> None:
    plan = begun(poll("a"), poll("b"), chance=random.Random(1))

    times_s = ask_times(plan, [*outcomes, ANSWERED, ANSWERED, ANSWERED])

    assert all(gap_s <= 17.6 for gap_s in gaps(times_s))
    assert len(plan.polls.asked()) == 2
