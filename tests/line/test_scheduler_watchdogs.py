"""The units' communication watchdogs: met whenever they can be, whatever else is asked of the line."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest

from gateway.line.rtu.outcome import Silent
from gateway.line.scheduler.requests import Priority, Slot
from gateway.line.scheduler.scheduler import IN_ROW
from gateway.line.scheduler.units import UnitState
from tests.line.fakes import poll
from tests.line.ideal_line import IdealLine
from tests.line.scheduled import ANSWERED, GARBLED, begun, job, job_of, key_of, take


def test_a_unit_is_asked_ahead_of_its_poll_when_half_of_its_watchdogs_time_has_passed() -> None:
    scheduler = begun(replace(poll("a", every_s=60.0), deadline_s=10.0))
    take(scheduler, 0.0)

    assert scheduler.next_due_s() == 5.0
    assert scheduler.pick(4.9) is None
    assert key_of(take(scheduler, 5.0)) == "a"


def test_any_request_that_a_unit_answered_counts() -> None:
    scheduler = begun(replace(poll("a", every_s=60.0), deadline_s=10.0))
    take(scheduler, 0.0)
    scheduler.jobs.submit(job(Priority.READ_BACK, unit=1), 4.0)
    take(scheduler, 4.0)

    assert scheduler.pick(8.9) is None
    assert key_of(take(scheduler, 9.0)) == "a"


def test_a_broadcast_counts_for_no_unit() -> None:
    scheduler = begun(replace(poll("a", every_s=60.0), deadline_s=10.0))
    take(scheduler, 0.0)
    scheduler.jobs.submit(job(unit=0), 4.0)
    take(scheduler, 4.0, Silent("broadcast"))

    assert key_of(take(scheduler, 5.0)) == "a"


def test_a_watchdog_goes_before_commands_and_after_stops() -> None:
    scheduler = begun(replace(poll("a", every_s=60.0), deadline_s=10.0))
    take(scheduler, 0.0)
    jobs = [job(unit=99), job(Priority.STOP, unit=99)]
    for each in jobs:
        scheduler.jobs.submit(each, 5.0)

    slots = [take(scheduler, 5.0) for _ in range(3)]

    assert [job_of(slot) for slot in slots if slot] == [jobs[1], None, jobs[0]]


def test_the_earliest_deadline_comes_first() -> None:
    scheduler = begun(
        replace(poll("a", unit=1, every_s=60.0), deadline_s=20.0),
        replace(poll("b", unit=2, every_s=60.0), deadline_s=10.0),
    )
    take(scheduler, 0.0)
    take(scheduler, 0.0)

    assert [key_of(take(scheduler, 11.0)) for _ in range(3)] == ["b", "a", None]


def test_starters_that_are_added_later_go_before_no_watchdog_that_is_running() -> None:
    scheduler = begun(replace(poll("a", every_s=60.0), deadline_s=10.0))
    take(scheduler, 0.0)
    for unit in (2, 3):
        scheduler.polls.add(replace(poll(f"{unit}", unit=unit, every_s=60.0), deadline_s=1.0), 5.0)

    assert [key_of(take(scheduler, 5.0)) for _ in range(3)] == ["a", "2", "3"]


def test_the_repetition_of_a_corrupted_read_waits_for_a_watchdog_that_is_due() -> None:
    scheduler = begun(poll("a"), replace(poll("b", unit=2, every_s=60.0), deadline_s=10.0))
    take(scheduler, 0.0)
    take(scheduler, 0.0)
    take(scheduler, 4.99, GARBLED)

    slots = [take(scheduler, 5.0) for _ in range(2)]

    assert [key_of(slot) for slot in slots] == ["b", "a"]
    assert [slot and slot.is_repetition for slot in slots] == [False, True]


def test_a_deadline_can_be_set_changed_and_taken_away_later() -> None:
    scheduler = begun(poll("a", every_s=60.0))
    scheduler.polls.set_deadline(1, 8.0)
    take(scheduler, 0.0)
    assert scheduler.next_due_s() == 4.0

    scheduler.polls.set_deadline(1, 30.0)
    assert scheduler.next_due_s() == 15.0
    scheduler.polls.set_deadline(1, 0.0)

    assert scheduler.next_due_s() == 60.0


def test_a_deadline_of_a_unit_without_polls_waits_for_one() -> None:
    scheduler = begun()
    scheduler.polls.set_deadline(1, 2.0)
    scheduler.jobs.submit(job(unit=1), 0.0)
    take(scheduler, 0.0)

    assert scheduler.pick(1.0) is None
    assert scheduler.next_due_s() == inf
    scheduler.polls.add(poll("a", every_s=60.0), 1.0)
    assert key_of(take(scheduler, 1.0)) == "a"
    assert scheduler.next_due_s() == 2.0


def test_a_unit_that_did_not_answer_is_asked_again_after_another_quarter() -> None:
    scheduler = begun(replace(poll("a", every_s=60.0), deadline_s=8.0))
    take(scheduler, 0.0)

    take(scheduler, 4.0, Silent())

    assert scheduler.pick(5.9) is None
    assert key_of(take(scheduler, 6.0)) == "a"


def test_no_line_time_is_reserved_for_a_unit_that_has_gone_silent_until_it_answers() -> None:
    scheduler = begun(replace(poll("a", every_s=1.0), deadline_s=2.0))
    take(scheduler, 0.0)
    take(scheduler, 1.0, Silent())
    take(scheduler, 2.0, Silent())

    assert scheduler.next_due_s() == 3.0
    assert key_of(take(scheduler, 3.0)) == "a"
    assert scheduler.next_due_s() == 4.0


def test_a_slot_that_is_put_back_stays_urgent_unless_the_unit_must_be_waited_for() -> None:
    scheduler = begun(replace(poll("a", every_s=60.0), deadline_s=10.0), poll("b", unit=2, every_s=60.0))
    take(scheduler, 0.0)
    take(scheduler, 0.0)
    slot = scheduler.pick(5.0)
    assert slot is not None
    scheduler.put_back(slot, 5.0)

    again = scheduler.pick(5.0)
    assert key_of(again) == "a"
    assert again is not None
    scheduler.put_back(again, 5.4)

    assert scheduler.pick(5.3) is None
    assert key_of(take(scheduler, 5.4)) == "a"


def test_when_the_watchdogs_alone_would_fill_the_line_others_have_a_slot_now_and_then() -> None:
    polls = [replace(poll(f"{unit}", unit=unit, every_s=60.0), deadline_s=0.2) for unit in range(1, 11)]
    line = IdealLine([*polls, poll("other", unit=11, every_s=1.0)], lambda slot: 0.05)

    line.run(20.0)

    keys = [key_of(slot) for _, slot in line.slots]
    assert max(line.gaps_s["other"]) < 2.0
    assert len(keys) - keys.count("other") > 0.9 * IN_ROW / (IN_ROW + 1) * len(keys)


def test_the_watchdog_with_the_least_margin_lately_is_reported_and_what_all_of_them_need() -> None:
    scheduler = begun(
        replace(poll("a", unit=1, every_s=60.0), deadline_s=10.0),
        replace(poll("b", unit=2, every_s=1.0), deadline_s=10.0),
    )
    for now_s in (0.0, 0.1):
        slot = scheduler.pick(now_s)
        assert slot is not None
        scheduler.record(slot, ANSWERED, now_s + 0.1)
    assert scheduler.polls.watchdog_statistics(0.2) == {"load": 0.02, "longest_share": 0.0, "unit": 0}

    take(scheduler, 12.0)
    take(scheduler, 12.1)

    assert scheduler.polls.watchdog_statistics(12.1)["longest_share"] == 1.2
    assert scheduler.polls.watchdog_statistics(70.0)["longest_share"] == 1.2
    assert scheduler.polls.watchdog_statistics(140.0)["longest_share"] == 0.0


def test_a_unit_that_was_silent_has_not_been_left() -> None:
    scheduler = begun(replace(poll("a", every_s=1.0), deadline_s=2.0))
    take(scheduler, 0.0)
    take(scheduler, 1.0, Silent())
    take(scheduler, 2.0, Silent())
    assert scheduler.polls.watchdog_statistics(3.0)["load"] == 0.0

    take(scheduler, 50.0)

    assert scheduler.polls.watchdog_statistics(50.0)["longest_share"] == 0.0


@pytest.mark.parametrize("lane", [Priority.COMMAND, Priority.READ_BACK])
def test_a_flood_of_jobs_keeps_neither_a_stop_nor_a_poll_waiting(lane: Priority) -> None:
    polls = [poll(f"{unit}", unit=unit, every_s=1.0) for unit in range(1, 6)]
    waits_s = []

    def took_s(slot: Slot) -> float:
        if slot.jobs and slot.jobs[0].lane is Priority.STOP:
            waits_s.append(line.now_s - slot.since_s)
        elif len(line.slots) % 7 == 0:
            line.scheduler.jobs.submit(job(Priority.STOP), line.now_s)
        line.scheduler.jobs.submit(job(lane, unit=99), line.now_s)
        line.scheduler.jobs.submit(job(lane, unit=99), line.now_s)
        return 0.03

    line = IdealLine(polls, took_s)
    line.run(60.0)

    assert len(waits_s) > 100
    assert max(waits_s) == pytest.approx(0.03)  # what was under way
    assert all(max(line.gaps_s[f"{unit}"]) < 2.0 for unit in range(1, 6))


def test_a_watchdog_that_becomes_known_has_counted_since_the_unit_was_reached_last() -> None:
    scheduler = begun(poll("a", every_s=60.0))
    take(scheduler, 0.0)

    scheduler.polls.set_deadline(1, 10.0)

    assert scheduler.next_due_s() == 5.0
    assert key_of(take(scheduler, 5.0)) == "a"


def test_a_watchdog_of_a_unit_that_went_silent_waits_until_it_is_reached_again() -> None:
    scheduler = begun(poll("a", every_s=60.0))
    take(scheduler, 0.0)
    for now_s in (60.0, 61.0, 62.0, 63.0, 64.0, 65.0):
        scheduler.polls.expedite("a", now_s)
        take(scheduler, now_s, Silent("no reply"))
    assert scheduler.polls.unit(1).state is UnitState.SILENT

    scheduler.polls.set_deadline(1, 10.0)

    assert scheduler.next_due_s() > 65.0
