"""The lanes of stops: what is shared, what is held, what lets watchdogs pass."""

from __future__ import annotations

from math import inf

import pytest

from gateway.line.rtu.outcome import Outcome, Silent
from gateway.line.scheduler.requests import Priority
from gateway.line.scheduler.scheduler import IN_ROW, SHARED_AFTER_S
from tests.line.fakes import poll
from tests.line.scheduled import ANSWERED, GARBLED, READ, begun, job, job_of, key_of, take

SILENT, NOT_SENT = Silent("no reply"), Silent("the line is never quiet", is_sent=False)
LATE_S = 2 * SHARED_AFTER_S


def test_a_stop_that_has_waited_for_long_is_sent_for_later_ones_of_its_unit_only() -> None:
    scheduler = begun()
    first, rider, other = job(Priority.STOP), job(Priority.STOP), job(Priority.STOP, unit=2)
    scheduler.jobs.submit(first, 0.0)
    scheduler.jobs.submit(rider, LATE_S)
    scheduler.jobs.submit(other, LATE_S)

    slots = [take(scheduler, LATE_S) for _ in range(3)]

    assert [slot and slot.jobs for slot in slots] == [(first, rider), (other,), None]


def test_a_stop_that_has_only_just_come_is_not_shared() -> None:
    scheduler = begun()
    jobs = [job(Priority.STOP), job(Priority.STOP)]
    for each in jobs:
        scheduler.jobs.submit(each, 0.0)

    slots = [take(scheduler, 0.0) for _ in range(2)]

    assert [slot and slot.jobs for slot in slots] == [(each,) for each in jobs]


def test_of_a_shared_stop_each_job_can_be_withdrawn_alone() -> None:
    scheduler = begun()
    first, second, third = (job(Priority.STOP) for _ in range(3))
    scheduler.jobs.submit(first, 0.0)
    scheduler.jobs.submit(second, LATE_S)
    scheduler.jobs.submit(third, LATE_S)

    assert scheduler.jobs.withdraw(first)
    assert scheduler.jobs.withdraw(third)
    assert scheduler.jobs.clear() == (second,)


def test_a_follow_up_whose_unit_may_not_be_asked_yet_lets_others_pass() -> None:
    scheduler = begun(poll("a", every_s=0.2))
    take(scheduler, 0.0)
    held, other = job(Priority.FOLLOW_UP, request=READ), job(Priority.FOLLOW_UP, unit=2, request=READ)
    scheduler.jobs.submit(held, 0.0)
    slot = scheduler.pick(0.0)
    assert slot is not None
    scheduler.put_back(slot, 0.5)
    scheduler.jobs.submit(other, 0.0)

    slots = [take(scheduler, 0.2) for _ in range(3)]

    assert [job_of(slot) or key_of(slot) for slot in slots] == [other, "a", None]
    scheduler.polls.remove("a")
    assert scheduler.next_due_s() == 0.5
    again = take(scheduler, 0.5)
    assert again is not None
    assert job_of(again) is held
    assert scheduler.next_due_s() == inf


def test_a_held_follow_up_can_be_withdrawn_and_taken_out() -> None:
    scheduler = begun()
    first, second = job(Priority.FOLLOW_UP, request=READ), job(Priority.FOLLOW_UP, request=READ)
    for each in (first, second):
        scheduler.jobs.submit(each, 0.0)
        slot = scheduler.pick(0.0)
        assert slot is not None
        scheduler.put_back(slot, 0.5)

    assert scheduler.jobs.withdraw(first)
    assert scheduler.jobs.clear() == (second,)


@pytest.mark.parametrize(
    ("outcome", "kinds"), [(SILENT, "fp" * 6), (GARBLED, "fp" * 6), (NOT_SENT, "f" * IN_ROW + "pfff")]
)
def test_after_a_read_back_without_an_answer_something_else_goes_first(outcome: Outcome, kinds: str) -> None:
    scheduler = begun(*(poll(str(unit), unit=unit, every_s=0.0) for unit in range(1, 31)))
    for _ in range(31):
        take(scheduler, 0.0)
    for _ in range(40):
        scheduler.jobs.submit(job(Priority.FOLLOW_UP, unit=99, request=READ), 8.0)

    now_s, seen = 8.0, ""
    while len(seen) < len(kinds):
        slot = scheduler.pick(now_s)
        assert slot is not None
        seen += "f" if slot.jobs else "p"
        now_s += 0.05
        scheduler.record(slot, outcome if slot.jobs else ANSWERED, now_s)

    assert seen == kinds


def test_follow_ups_and_watchdogs_that_are_due_alternate_and_let_a_poll_pass() -> None:
    units = range(1, 31)
    scheduler = begun(*(poll(str(unit), unit=unit, every_s=0.0) for unit in units))
    for unit in units:
        scheduler.polls.set_deadline(unit, 10.0)
    for _ in range(31):
        take(scheduler, 0.0)
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
