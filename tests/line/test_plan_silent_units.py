"""Units that do not answer, and lines on which nobody could be heard."""

from __future__ import annotations

import random
from dataclasses import replace
from math import inf

import pytest

from gateway.line.rtu.outcome import Silent
from gateway.line.scheduler.requests import Priority
from gateway.line.scheduler.scheduler import Verdict
from gateway.line.scheduler.units import UnitState
from tests.line.fakes import poll
from tests.line.planned import ANSWERED, ask_times, begun, gaps, job, key_of, take


def test_after_an_outage_every_poll_is_asked_once() -> None:
    plan = begun(poll("a", every_s=1.0), poll("b", every_s=1.0))
    take(plan, 0.0)
    take(plan, 0.0)

    plan.begin(100.0)

    assert [key_of(take(plan, 100.0)) for _ in range(3)] == ["a", "b", None]


def test_after_an_outage_each_units_state_is_told_anew() -> None:
    plan = begun(poll("a"))
    take(plan, 0.0)

    plan.begin(100.0)

    turn = plan.pick(100.0)
    assert turn is not None
    assert plan.record(turn, ANSWERED, 100.0).is_answering is True


def test_a_silent_unit_is_asked_ever_less_often_up_to_the_ceiling() -> None:
    plan = begun(poll("a", every_s=1.0))

    asked_s = ask_times(plan, [Silent()] * 9)

    assert gaps(asked_s) == [1.0, 1.0, 2.0, 4.0, 8.0, 16.0, 16.0, 16.0]


@pytest.mark.parametrize(
    ("every_s", "expected"), [(0.0, [0.0, 1.0, 1.0]), (5.0, [5.0, 5.0, 10.0]), (60.0, [60.0] * 3)]
)
def test_the_back_off_begins_at_the_polls_own_period(every_s: float, expected: list[float]) -> None:
    plan = begun(poll("a", every_s=every_s))

    assert gaps(ask_times(plan, [Silent()] * 4)) == expected


def test_a_unit_with_a_watchdog_is_asked_often_enough_for_it_for_it_may_hear_what_we_do_not() -> None:
    plan = begun(replace(poll("a", every_s=1.0), deadline_s=10.0))

    assert max(gaps(ask_times(plan, [Silent()] * 9))) == 1.25


def test_the_back_off_is_spread_by_a_tenth_either_way() -> None:
    plan = begun(poll("a", every_s=1.0), chance=random.Random(7))

    late = gaps(ask_times(plan, [Silent()] * 200))[6:]

    assert min(late) >= 14.4
    assert max(late) <= 17.6
    assert max(late) - min(late) > 2.0


def test_a_silent_unit_is_asked_by_its_first_poll_only_and_in_full_once_it_answers() -> None:
    plan = begun(poll("status"), poll("current"), poll("other", unit=2))
    for _ in range(3):
        turn = plan.pick(0.0)
        assert turn is not None
        plan.record(turn, Silent() if turn.unit == 1 else ANSWERED, 0.0)

    assert plan.polls.state_of(1) is UnitState.SILENT
    assert [it.key for it in plan.polls.asked()] == ["status", "other"]
    assert [key_of(take(plan, at_s)) for at_s in (0.9, 1.0, 1.0)] == [None, "other", "status"]
    assert [it.key for it in plan.polls.asked()] == ["status", "current", "other"]
    assert key_of(take(plan, 1.0)) == "current"


def test_an_answered_job_brings_a_silent_unit_back_too() -> None:
    plan = begun(poll("status"), poll("current"))
    take(plan, 0.0, Silent())
    take(plan, 0.0, Silent())
    plan.jobs.submit(job(), 0.1)

    turn = plan.pick(0.1)
    assert turn is not None
    assert plan.record(turn, ANSWERED, 0.1) == Verdict(is_final=True, is_answering=True)

    assert {key_of(take(plan, 0.1)), key_of(take(plan, 0.1))} == {"status", "current"}


def test_jobs_that_a_silent_unit_does_not_answer_leave_its_back_off_alone() -> None:
    plan = begun(poll("status"))
    ask_times(plan, [Silent(), Silent()])
    due_s = plan.next_due_s()

    plan.jobs.submit(job(), 1.0)
    take(plan, 1.0, Silent())

    assert plan.next_due_s() == due_s


def test_a_broadcast_says_nothing_of_any_unit() -> None:
    plan = begun()
    plan.jobs.submit(job(unit=0), 0.0)

    turn = plan.pick(0.0)

    assert turn is not None
    assert plan.record(turn, Silent("broadcast"), 0.0) == Verdict(is_final=True)
    assert plan.polls.state_of(0) is UnitState.NEW


def test_an_expected_silence_is_not_reported_and_asks_only_the_probe() -> None:
    plan = begun(poll("status", every_s=0.2), poll("current", every_s=0.2))
    take(plan, 0.0)
    take(plan, 0.0)
    plan.polls.expect_silence(1, 10.0)

    times_s = ask_times(plan, [Silent()] * 10)

    assert gaps(times_s) == pytest.approx([0.0, *([1.0] * 8)])
    assert plan.polls.unit(1).is_online
    assert take(plan, 10.3, ANSWERED) is not None
    assert len(plan.polls.asked()) == 2


def test_an_expected_silence_ends_and_then_misses_count() -> None:
    plan = begun(poll("status"), poll("current"))
    plan.polls.expect_silence(1, 2.0)

    for at_s in (0.0, 1.0, 2.0, 3.0):
        take(plan, at_s, Silent())

    assert plan.polls.state_of(1) is UnitState.SILENT


def test_a_silence_can_be_expected_of_a_unit_without_polls() -> None:
    plan = begun()
    plan.polls.expect_silence(9, 2.0)
    plan.jobs.submit(job(unit=9), 0.0)

    take(plan, 0.0, Silent())

    assert plan.polls.state_of(9) is UnitState.SUSPECT
    assert plan.next_due_s() == inf


def test_a_unit_without_polls_can_go_silent_and_its_first_poll_is_its_probe() -> None:
    plan = begun()
    for at_s in (0.0, 1.0, 2.0):
        plan.jobs.submit(job(unit=9), at_s)
        take(plan, at_s, Silent())
    assert plan.polls.state_of(9) is UnitState.SILENT

    plan.polls.add(poll("probe", unit=9), 3.0)
    plan.polls.add(poll("held", unit=9), 3.0)

    assert key_of(take(plan, 3.0, Silent())) == "probe"
    assert [it.key for it in plan.polls.asked()] == ["probe"]


def test_a_silent_units_back_off_outlasts_a_change_of_period() -> None:
    plan = begun(poll("a", every_s=1.0))
    ask_times(plan, [Silent()] * 5)
    due_s = plan.next_due_s()

    plan.polls.set_every("a", 0.2, 20.0)

    assert plan.next_due_s() == due_s


def test_hastening_any_poll_of_a_silent_unit_hastens_its_probe() -> None:
    plan = begun(poll("status"), poll("current"))
    take(plan, 0.0, Silent())
    take(plan, 0.0, Silent())

    plan.polls.expedite("current", 0.5)

    assert key_of(take(plan, 0.5)) == "status"


def test_when_the_probe_is_removed_the_next_poll_takes_its_place() -> None:
    plan = begun(poll("a"), poll("b"), poll("c"))
    take(plan, 0.0, Silent())
    take(plan, 0.0, Silent())
    due_s = plan.next_due_s()

    plan.polls.remove("c")
    plan.polls.remove("a")

    assert plan.next_due_s() == due_s
    assert key_of(take(plan, due_s)) == "b"
    plan.polls.remove("b")
    assert plan.next_due_s() == inf


def test_after_an_outage_a_silent_unit_is_still_asked_by_its_probe_only() -> None:
    plan = begun(poll("a"), poll("b"))
    take(plan, 0.0, Silent())
    take(plan, 0.0, Silent())

    plan.begin(100.0)

    assert key_of(take(plan, 100.0, Silent())) == "a"
    assert plan.pick(100.0) is None


def test_after_an_outage_the_first_poll_of_each_unit_comes_before_what_we_ask_of_our_own_accord() -> None:
    plan = begun(poll("a", unit=1), poll("b", unit=1), poll("c", unit=2))
    plan.jobs.submit(job(Priority.READ_BACK), 0.0)

    assert [key_of(take(plan, 0.0)) for _ in range(3)] == ["a", "c", None]


def test_when_nobody_could_be_heard_all_are_asked_at_once() -> None:
    plan = begun(*(poll(f"{unit}", unit=unit) for unit in range(1, 31)))
    now_s = 0.0
    while now_s < 60.0:
        turn = plan.pick(now_s)
        now_s = now_s + 0.1 if turn is not None else plan.next_due_s()
        if turn is not None:
            plan.record(turn, Silent(), now_s)

    plan.polls.expedite_all(now_s)

    answered = set()
    for _ in range(30):
        turn = take(plan, now_s)
        assert turn is not None
        answered.add(turn.unit)
    assert answered == set(range(1, 31))
