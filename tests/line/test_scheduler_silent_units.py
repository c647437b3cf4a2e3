"""Units that do not answer, and lines on which none could be received."""

from __future__ import annotations

import random
from dataclasses import replace
from math import inf

import pytest

from gateway.line.rtu.outcome import Silent
from gateway.line.scheduler.requests import Priority, Verdict
from gateway.line.scheduler.units import UnitState
from tests.line.fakes import poll
from tests.line.scheduled import ANSWERED, ask_times, begun, gaps, job, key_of, take


def test_after_an_outage_every_poll_is_asked_once() -> None:
    scheduler = begun(poll("a", every_s=1.0), poll("b", every_s=1.0))
    take(scheduler, 0.0)
    take(scheduler, 0.0)

    scheduler.polls.begin(100.0)

    assert [key_of(take(scheduler, 100.0)) for _ in range(3)] == ["a", "b", None]


def test_after_an_outage_each_units_state_is_reported_anew() -> None:
    scheduler = begun(poll("a"))
    take(scheduler, 0.0)

    scheduler.polls.begin(100.0)

    slot = scheduler.pick(100.0)
    assert slot is not None
    assert scheduler.record(slot, ANSWERED, 100.0).is_answering is True


def test_a_silent_unit_is_asked_ever_less_often_up_to_the_ceiling() -> None:
    scheduler = begun(poll("a", every_s=1.0))

    asked_s = ask_times(scheduler, [Silent()] * 9)

    assert gaps(asked_s) == [1.0, 1.0, 2.0, 4.0, 8.0, 16.0, 16.0, 16.0]


@pytest.mark.parametrize(
    ("every_s", "expected"), [(0.0, [0.0, 1.0, 1.0]), (5.0, [5.0, 5.0, 10.0]), (60.0, [60.0] * 3)]
)
def test_the_back_off_begins_at_the_polls_own_period(every_s: float, expected: list[float]) -> None:
    scheduler = begun(poll("a", every_s=every_s))

    assert gaps(ask_times(scheduler, [Silent()] * 4)) == expected


def test_a_unit_with_a_watchdog_is_asked_often_enough_for_it_as_it_may_receive_though_we_do_not() -> None:
    scheduler = begun(replace(poll("a", every_s=1.0), deadline_s=10.0))

    assert max(gaps(ask_times(scheduler, [Silent()] * 9))) == 1.25


def test_the_back_off_is_spread_by_a_tenth_either_way() -> None:
    scheduler = begun(poll("a", every_s=1.0), chance=random.Random(7))

    late = gaps(ask_times(scheduler, [Silent()] * 200))[6:]

    assert min(late) >= 14.4
    assert max(late) <= 17.6
    assert max(late) - min(late) > 2.0


def test_a_silent_unit_is_asked_by_its_first_poll_only_and_in_full_once_it_answers() -> None:
    scheduler = begun(poll("status"), poll("current"), poll("other", unit=2))
    for _ in range(3):
        slot = scheduler.pick(0.0)
        assert slot is not None
        scheduler.record(slot, Silent() if slot.unit == 1 else ANSWERED, 0.0)

    assert scheduler.polls.unit(1).state is UnitState.SILENT
    assert [it.key for it in scheduler.polls.asked()] == ["status", "other"]
    assert [key_of(take(scheduler, at_s)) for at_s in (0.9, 1.0, 1.0)] == [None, "other", "status"]
    assert [it.key for it in scheduler.polls.asked()] == ["status", "current", "other"]
    assert key_of(take(scheduler, 1.0)) == "current"


def test_an_answered_job_brings_a_silent_unit_back_too() -> None:
    scheduler = begun(poll("status"), poll("current"))
    take(scheduler, 0.0, Silent())
    take(scheduler, 0.0, Silent())
    scheduler.jobs.submit(job(), 0.1)

    slot = scheduler.pick(0.1)
    assert slot is not None
    assert scheduler.record(slot, ANSWERED, 0.1) == Verdict(is_final=True, is_answering=True)

    assert {key_of(take(scheduler, 0.1)), key_of(take(scheduler, 0.1))} == {"status", "current"}


def test_jobs_that_a_silent_unit_does_not_answer_leave_its_back_off_alone() -> None:
    scheduler = begun(poll("status"))
    ask_times(scheduler, [Silent(), Silent()])
    due_s = scheduler.next_due_s()

    scheduler.jobs.submit(job(), 1.0)
    take(scheduler, 1.0, Silent())

    assert scheduler.next_due_s() == due_s


def test_a_broadcast_says_nothing_of_any_unit() -> None:
    scheduler = begun()
    scheduler.jobs.submit(job(unit=0), 0.0)

    slot = scheduler.pick(0.0)

    assert slot is not None
    assert scheduler.record(slot, Silent("broadcast"), 0.0) == Verdict(is_final=True)
    assert scheduler.polls.unit(0).state is UnitState.NEW


def test_an_expected_silence_is_not_reported_and_asks_only_the_probe() -> None:
    scheduler = begun(poll("status", every_s=0.2), poll("current", every_s=0.2))
    take(scheduler, 0.0)
    take(scheduler, 0.0)
    scheduler.polls.unit(1).expect_silence(10.0)

    times_s = ask_times(scheduler, [Silent()] * 10)

    assert gaps(times_s) == pytest.approx([0.0, *([1.0] * 8)])
    assert scheduler.polls.unit(1).is_online
    assert take(scheduler, 10.3, ANSWERED) is not None
    assert len(scheduler.polls.asked()) == 2


def test_an_expected_silence_ends_and_then_misses_count() -> None:
    scheduler = begun(poll("status"), poll("current"))
    scheduler.polls.unit(1).expect_silence(2.0)

    for at_s in (0.0, 1.0, 2.0, 3.0):
        take(scheduler, at_s, Silent())

    assert scheduler.polls.unit(1).state is UnitState.SILENT


def test_a_silence_can_be_expected_of_a_unit_without_polls() -> None:
    scheduler = begun()
    scheduler.polls.unit(9).expect_silence(2.0)
    scheduler.jobs.submit(job(unit=9), 0.0)

    take(scheduler, 0.0, Silent())

    assert scheduler.polls.unit(9).state is UnitState.SUSPECT
    assert scheduler.next_due_s() == inf


def test_a_unit_without_polls_can_go_silent_and_its_first_poll_is_its_probe() -> None:
    scheduler = begun()
    for at_s in (0.0, 1.0, 2.0):
        scheduler.jobs.submit(job(unit=9), at_s)
        take(scheduler, at_s, Silent())
    assert scheduler.polls.unit(9).state is UnitState.SILENT

    scheduler.polls.add(poll("probe", unit=9), 3.0)
    scheduler.polls.add(poll("held", unit=9), 3.0)

    assert key_of(take(scheduler, 3.0, Silent())) == "probe"
    assert [it.key for it in scheduler.polls.asked()] == ["probe"]


def test_a_silent_units_back_off_outlasts_a_change_of_period() -> None:
    scheduler = begun(poll("a", every_s=1.0))
    ask_times(scheduler, [Silent()] * 5)
    due_s = scheduler.next_due_s()

    scheduler.polls.set_every("a", 0.2, 20.0)

    assert scheduler.next_due_s() == due_s


def test_expediting_any_poll_of_a_silent_unit_expedites_its_probe() -> None:
    scheduler = begun(poll("status"), poll("current"))
    take(scheduler, 0.0, Silent())
    take(scheduler, 0.0, Silent())

    scheduler.polls.expedite("current", 0.5)

    assert key_of(take(scheduler, 0.5)) == "status"


def test_when_the_probe_is_removed_the_next_poll_takes_its_place() -> None:
    scheduler = begun(poll("a"), poll("b"), poll("c"))
    take(scheduler, 0.0, Silent())
    take(scheduler, 0.0, Silent())
    due_s = scheduler.next_due_s()

    scheduler.polls.remove("c")
    scheduler.polls.remove("a")

    assert scheduler.next_due_s() == due_s
    assert key_of(take(scheduler, due_s)) == "b"
    scheduler.polls.remove("b")
    assert scheduler.next_due_s() == inf


def test_after_an_outage_a_silent_unit_is_still_asked_by_its_probe_only() -> None:
    scheduler = begun(poll("a"), poll("b"))
    take(scheduler, 0.0, Silent())
    take(scheduler, 0.0, Silent())

    scheduler.polls.begin(100.0)

    assert key_of(take(scheduler, 100.0, Silent())) == "a"
    assert scheduler.pick(100.0) is None


def test_after_an_outage_the_first_poll_of_each_unit_comes_before_what_we_ask_of_our_own_accord() -> None:
    scheduler = begun(poll("a", unit=1), poll("b", unit=1), poll("c", unit=2))
    scheduler.jobs.submit(job(Priority.PATROL), 0.0)

    assert [key_of(take(scheduler, 0.0)) for _ in range(3)] == ["a", "c", None]


def test_when_no_unit_could_be_received_all_are_asked_at_once() -> None:
    scheduler = begun(*(poll(f"{unit}", unit=unit) for unit in range(1, 31)))
    now_s, slot = 0.0, None
    while now_s < 60.0 or slot is None:  # until a probe has just used up their share of the line's time
        slot = scheduler.pick(now_s)
        now_s = now_s + 0.1 if slot is not None else scheduler.next_due_s()
        if slot is not None:
            scheduler.record(slot, Silent(), now_s)

    scheduler.polls.expedite_all(now_s)

    answered = set()
    for _ in range(30):
        slot = take(scheduler, now_s)
        assert slot is not None
        answered.add(slot.unit)
    assert answered == set(range(1, 31))


def test_when_the_probe_is_removed_while_it_is_asked_the_next_poll_takes_its_place() -> None:
    scheduler = begun(poll("a"), poll("b"))
    take(scheduler, 0.0, Silent())
    take(scheduler, 0.0, Silent())
    now_s = scheduler.next_due_s()
    probe = scheduler.pick(now_s)
    assert probe is not None

    scheduler.polls.remove("a")
    scheduler.record(probe, Silent(), now_s)

    assert scheduler.next_due_s() <= now_s
    assert key_of(take(scheduler, now_s)) == "b"
