"""The lanes of stops: what is shared, what is held, what lets watchdogs pass."""

from __future__ import annotations

from math import inf

from gateway.line.scheduler.job_queue import SHARED_AFTER_S
from gateway.line.scheduler.requests import Priority
from gateway.line.scheduler.scheduler import IN_ROW
from tests.line.fakes import poll
from tests.line.planned import ANSWERED, READ, begun, job, key_of, take

LATE_S = 2 * SHARED_AFTER_S


def test_a_stop_that_has_waited_for_long_is_sent_for_later_ones_of_its_unit_only() -> None:
    plan = begun()
    first, rider, other = job(Priority.STOP), job(Priority.STOP), job(Priority.STOP, unit=2)
    plan.jobs.submit(first, 0.0)
    plan.jobs.submit(rider, LATE_S)
    plan.jobs.submit(other, LATE_S)

    turns = [take(plan, LATE_S) for _ in range(3)]

    assert [turn and turn.jobs for turn in turns] == [(first, rider), (other,), None]


def test_a_stop_that_has_only_just_come_is_not_shared() -> None:
    plan = begun()
    jobs = [job(Priority.STOP), job(Priority.STOP)]
    for each in jobs:
        plan.jobs.submit(each, 0.0)

    turns = [take(plan, 0.0) for _ in range(2)]

    assert [turn and turn.jobs for turn in turns] == [(each,) for each in jobs]


def test_of_a_shared_stop_each_job_can_be_withdrawn_alone() -> None:
    plan = begun()
    first, second, third = (job(Priority.STOP) for _ in range(3))
    plan.jobs.submit(first, 0.0)
    plan.jobs.submit(second, LATE_S)
    plan.jobs.submit(third, LATE_S)

    assert plan.jobs.withdraw(first)
    assert plan.jobs.withdraw(third)
    assert plan.jobs.clear() == (second,)


def test_a_follow_up_whose_unit_may_not_be_asked_yet_lets_others_pass() -> None:
    plan = begun(poll("a", every_s=0.2))
    take(plan, 0.0)
    held, other = job(Priority.FOLLOW_UP, request=READ), job(Priority.FOLLOW_UP, unit=2, request=READ)
    plan.jobs.submit(held, 0.0)
    turn = plan.pick(0.0)
    assert turn is not None
    plan.put_back(turn, 0.5)
    plan.jobs.submit(other, 0.0)

    turns = [take(plan, 0.2) for _ in range(3)]

    assert [turn and (turn.job or key_of(turn)) for turn in turns] == [other, "a", None]
    plan.polls.remove("a")
    assert plan.next_due_s() == 0.5
    again = take(plan, 0.5)
    assert again is not None
    assert again.job is held
    assert plan.next_due_s() == inf


def test_a_held_follow_up_can_be_withdrawn_and_taken_out() -> None:
    plan = begun()
    first, second = job(Priority.FOLLOW_UP, request=READ), job(Priority.FOLLOW_UP, request=READ)
    for each in (first, second):
        plan.jobs.submit(each, 0.0)
        turn = plan.pick(0.0)
        assert turn is not None
        plan.put_back(turn, 0.5)

    assert plan.jobs.withdraw(first)
    assert plan.jobs.clear() == (second,)


def test_follow_ups_and_watchdogs_that_are_due_take_turns_and_let_a_poll_pass() -> None:
    units = range(1, 31)
    plan = begun(*(poll(str(unit), unit=unit, every_s=0.0) for unit in units))
    for unit in units:
        plan.polls.set_deadline(unit, 10.0)
    for _ in range(31):
        take(plan, 0.0)
    for _ in range(40):
        plan.jobs.submit(job(Priority.FOLLOW_UP, unit=99, request=READ), 8.0)

    now_s, kinds = 8.0, ""
    for _ in range(40):
        turn = plan.pick(now_s)
        assert turn is not None
        kinds += "p" if turn.job is None else "f"
        now_s += 0.05
        plan.record(turn, ANSWERED, now_s)

    assert kinds == ("f" * IN_ROW + "p" * (IN_ROW + 1)) * 2 + "f" * 6
