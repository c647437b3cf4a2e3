"""Jobs and repetitions among the polls."""

from __future__ import annotations

from math import inf

from gateway.line.rtu.outcome import Garbled, Silent
from gateway.line.scheduler.line_time import JOBS_BURST_S, JOBS_SHARE
from gateway.line.scheduler.requests import Priority, Verdict
from gateway.line.scheduler.scheduler import OLDEST_EVERY
from gateway.line.scheduler.units import UnitState
from tests.line.fakes import poll
from tests.line.scheduled import ANSWERED, GARBLED, READ, WRITE, begun, job, job_of, key_of, take


def test_jobs_come_before_polls_and_lanes_in_their_order() -> None:
    scheduler = begun(poll("a", every_s=0.0))
    take(scheduler, 0.0)
    jobs = {lane: job(lane) for lane in reversed(Priority)}
    for waiting in jobs.values():
        scheduler.jobs.submit(waiting, 0.0)

    assert scheduler.next_due_s() == -inf
    slots = [take(scheduler, 0.0) for _ in range(9)]

    assert [job_of(slot) for slot in slots if slot] == [jobs[lane] for lane in sorted(Priority)] + [None]


def test_every_units_first_poll_waits_for_stops_commands_and_questions_for_watchdogs_only() -> None:
    scheduler = begun(poll("a"), poll("b", unit=2), poll("c"))
    jobs = {lane: job(lane, unit=99) for lane in Priority}
    for waiting in jobs.values():
        scheduler.jobs.submit(waiting, 0.0)

    slots = [take(scheduler, 0.0) for _ in range(11)]

    assert [key_of(slot) or job_of(slot) for slot in slots] == [
        *(jobs[lane] for lane in sorted(Priority) if lane <= Priority.WATCHDOG),
        *("a", "b", jobs[Priority.IDENTITY], jobs[Priority.PATROL], "c"),
    ]


def test_the_gateways_own_questions_wait_for_all_commands_however_old_they_are() -> None:
    scheduler = begun(poll("a"))
    take(scheduler, 0.0)
    for lane in (Priority.WATCHDOG, Priority.IDENTITY, Priority.PATROL):
        scheduler.jobs.submit(job(lane), 0.0)
    for lane in (Priority.COMMAND, Priority.READ_BACK, Priority.PARAMETERS) * 5:
        scheduler.jobs.submit(job(lane), 1.0)

    slots = [take(scheduler, 1.0) for _ in range(18)]

    lanes = [slot.lane for slot in slots if slot is not None and slot.lane is not None]
    assert lanes[15:] == [Priority.WATCHDOG, Priority.IDENTITY, Priority.PATROL]


def test_jobs_use_what_they_have_saved_up_and_then_every_other_slot() -> None:
    scheduler = begun(poll("a", every_s=0.0))
    take(scheduler, 0.0)
    for _ in range(60):
        scheduler.jobs.submit(job(), 0.0)

    now_s, kinds = 0.0, ""
    for _ in range(60):
        slot = scheduler.pick(now_s)
        assert slot is not None
        kinds += "p" if not slot.jobs else "j"
        now_s += 0.05
        scheduler.record(slot, ANSWERED, now_s)

    saved = round(JOBS_BURST_S / JOBS_SHARE / 0.05)
    assert kinds[: saved - 1] == "j" * (saved - 1)
    assert kinds[saved + 2 :] in ("jp" * 60, "pj" * 60) or kinds[saved + 2 :] in "jp" * 60


def test_every_fourth_job_is_the_oldest_that_waits() -> None:
    scheduler = begun()
    old = job(Priority.PARAMETERS)
    scheduler.jobs.submit(old, 0.0)
    for _ in range(10):
        scheduler.jobs.submit(job(), 1.0)

    slots = [take(scheduler, 1.0) for _ in range(11)]

    assert [job_of(slot) for slot in slots if slot].index(old) == OLDEST_EVERY - 1


def test_jobs_go_on_while_no_poll_is_due() -> None:
    scheduler = begun(poll("a", every_s=10.0))
    take(scheduler, 0.0)
    for _ in range(40):
        scheduler.jobs.submit(job(), 0.0)

    assert all(take(scheduler, 1.0) for _ in range(40))


def test_a_stop_overtakes_an_overdue_poll_however_many_jobs_there_were() -> None:
    scheduler = begun(poll("a", every_s=0.0))
    for _ in range(10):
        scheduler.jobs.submit(job(Priority.STOP), 0.0)

    slots = [take(scheduler, 0.0) for _ in range(11)]

    assert [job_of(slot) is not None for slot in slots] == [True] * 10 + [False]


def test_a_waiting_job_can_be_withdrawn_and_one_under_way_cannot() -> None:
    scheduler = begun()
    first, second = job(), job()
    scheduler.jobs.submit(first, 0.0)
    scheduler.jobs.submit(second, 0.0)

    assert scheduler.jobs.withdraw(second)
    assert not scheduler.jobs.withdraw(second)
    scheduler.pick(0.0)
    assert not scheduler.jobs.withdraw(first)
    assert scheduler.pick(0.0) is None


def test_all_waiting_jobs_can_be_taken_out() -> None:
    scheduler = begun()
    jobs = [job(Priority.READ_BACK), job(Priority.STOP)]
    for waiting in jobs:
        scheduler.jobs.submit(waiting, 0.0)

    assert scheduler.jobs.clear() == (jobs[1], jobs[0])
    assert scheduler.jobs.clear() == ()


def test_a_garbled_poll_is_repeated_once_at_once_and_counts_when_it_was_no_use() -> None:
    scheduler = begun(poll("a"), poll("b"))
    first = scheduler.pick(0.0)
    assert first is not None
    assert scheduler.record(first, GARBLED, 0.1) == Verdict(is_final=False)
    assert scheduler.polls.unit(1).state is UnitState.NEW

    second = scheduler.pick(0.1)

    assert second is not None
    assert key_of(second) == "a"
    assert second.is_repetition
    assert scheduler.record(second, GARBLED, 0.2) == Verdict(is_final=True)
    assert scheduler.polls.unit(1).state is UnitState.SUSPECT
    third = scheduler.pick(0.2)
    assert third is not None
    assert (key_of(third), third.is_repetition) == ("b", False)


def test_a_poll_whose_outcome_is_open_is_asked_again_at_once_as_often_as_needed() -> None:
    scheduler = begun(poll("a", every_s=1.0), poll("b", every_s=1.0))

    for now_s in (0.0, 0.1, 0.2):
        slot = scheduler.pick(now_s)
        assert slot is not None
        assert key_of(slot) == "a"
        assert not slot.is_repetition
        assert not scheduler.record(slot, ANSWERED, now_s + 0.1, is_open=True).is_final
    assert scheduler.polls.unit(1).state is UnitState.ANSWERING

    assert [key_of(take(scheduler, at_s)) for at_s in (0.3, 0.3, 0.9, 1.0, 1.0)] == ["a", "b", None, "a", "b"]


def test_a_corrupted_reply_to_what_was_open_is_repeated_once() -> None:
    scheduler = begun(poll("a"))
    finals = []
    for outcome, is_open in ((ANSWERED, True), (GARBLED, False), (ANSWERED, True), (GARBLED, False)):
        slot = scheduler.pick(0.0)
        assert slot is not None
        finals.append(scheduler.record(slot, outcome, 0.0, is_open=is_open).is_final)

    assert finals == [False, False, False, True]


def test_an_open_answer_to_a_probe_brings_its_unit_back_and_the_probe_is_asked_once_more() -> None:
    scheduler = begun(poll("a", every_s=1.0), poll("b", every_s=1.0))
    for now_s in (0.0, 0.0):
        take(scheduler, now_s, Silent())
    assert scheduler.polls.unit(1).state is UnitState.SILENT
    probe = scheduler.pick(1.0)
    assert probe is not None

    assert scheduler.record(probe, ANSWERED, 1.0, is_open=True) == Verdict(is_final=False, is_answering=True)

    assert [key_of(take(scheduler, 1.0)) for _ in range(3)] == ["a", "b", None]


def test_an_open_poll_that_is_put_back_is_asked_once_more_and_a_removed_one_is_not() -> None:
    scheduler = begun(poll("a", every_s=1.0), poll("b", every_s=1.0))
    first = scheduler.pick(0.0)
    assert first is not None
    scheduler.record(first, ANSWERED, 0.0, is_open=True)
    again = scheduler.pick(0.0)
    assert again is not None
    scheduler.put_back(again, 0.3)
    assert [key_of(take(scheduler, at_s)) for at_s in (0.0, 0.2, 0.3, 0.3)] == ["b", None, "a", None]

    slot = scheduler.pick(1.0)
    assert slot is not None
    assert key_of(slot) == "b"
    scheduler.record(slot, ANSWERED, 1.0, is_open=True)
    scheduler.polls.remove("b")

    assert [key_of(take(scheduler, 2.1)) for _ in range(2)] == ["a", None]


def test_a_job_whose_outcome_is_open_is_sent_again_before_the_others_of_its_priority() -> None:
    scheduler = begun()
    read, other = job(Priority.READ_BACK, request=READ), job(Priority.READ_BACK, request=READ)
    scheduler.jobs.submit(read, 0.0)
    scheduler.jobs.submit(other, 0.0)

    for is_open in (True, True, False):
        slot = scheduler.pick(0.0)
        assert slot is not None
        assert job_of(slot) is read
        assert scheduler.record(slot, ANSWERED, 0.0, is_open=is_open).is_final is not is_open

    slot = take(scheduler, 0.0)
    assert slot is not None
    assert job_of(slot) is other


def test_time_in_which_a_job_may_not_be_sent_is_not_charged() -> None:
    scheduler = begun(poll("a", every_s=10.0))
    take(scheduler, 0.0)
    scheduler.jobs.submit(job(Priority.READ_BACK, request=READ), 1.0)
    slot = scheduler.pick(1.0)
    assert slot is not None
    scheduler.put_back(slot, 2.0)

    slot = scheduler.pick(2.0)
    assert slot is not None
    scheduler.record(slot, ANSWERED, 2.1)

    assert scheduler.jobs.budget.room_at_s <= 2.1


def test_a_garbled_read_job_is_repeated_before_the_others_of_its_lane() -> None:
    scheduler = begun()
    read, other = job(Priority.READ_BACK, request=READ), job(Priority.READ_BACK, request=READ)
    scheduler.jobs.submit(read, 0.0)
    scheduler.jobs.submit(other, 0.0)

    first = scheduler.pick(0.0)
    assert first is not None
    assert not scheduler.record(first, GARBLED, 0.0).is_final
    again = scheduler.pick(0.0)

    assert again is not None
    assert job_of(again) is read
    assert scheduler.record(again, GARBLED, 0.0).is_final


def test_a_garbled_write_is_never_repeated() -> None:
    scheduler = begun()
    scheduler.jobs.submit(job(request=WRITE), 0.0)

    slot = scheduler.pick(0.0)

    assert slot is not None
    assert scheduler.record(slot, GARBLED, 0.0).is_final
    assert scheduler.pick(0.0) is None


def test_what_was_not_sent_for_noise_is_not_repeated_at_once() -> None:
    scheduler = begun(poll("a", every_s=1.0))

    slot = scheduler.pick(0.0)

    assert slot is not None
    assert scheduler.record(slot, Garbled("noise", b"", is_sent=False), 0.0).is_final
    assert scheduler.pick(0.0) is None


def test_what_is_put_back_until_its_unit_may_be_asked_lets_others_pass() -> None:
    scheduler = begun(poll("a"), poll("b", unit=2))
    first, second = job(Priority.IDENTITY), job(Priority.IDENTITY, unit=2)
    slot = scheduler.pick(0.0)
    assert slot is not None
    scheduler.put_back(slot, 0.5)
    scheduler.jobs.submit(first, 0.0)
    scheduler.jobs.submit(second, 0.0)

    assert key_of(take(scheduler, 0.0)) == "b"
    taken_back = scheduler.pick(0.0)
    assert taken_back is not None
    assert job_of(taken_back) is first
    scheduler.put_back(taken_back, 0.5)

    slots = [take(scheduler, at_s) for at_s in (0.0, 0.1, 0.5, 0.5)]
    assert [job_of(slot) or key_of(slot) for slot in slots] == [second, None, "a", first]


def test_a_removed_poll_that_is_put_back_stays_removed() -> None:
    scheduler = begun(poll("a"))
    slot = scheduler.pick(0.0)
    assert slot is not None

    scheduler.polls.remove("a")
    scheduler.put_back(slot, 0.5)

    assert scheduler.next_due_s() == inf


def test_a_poll_that_is_removed_before_its_repetition_is_not_repeated() -> None:
    scheduler = begun(poll("a"), poll("b"))
    slot = scheduler.pick(0.0)
    assert slot is not None
    scheduler.record(slot, GARBLED, 0.1)

    scheduler.polls.remove("a")

    assert key_of(take(scheduler, 0.1)) == "b"


def test_a_repetition_that_is_put_back_at_once_is_still_the_next() -> None:
    scheduler = begun(poll("a"), poll("b"))
    slot = scheduler.pick(0.0)
    assert slot is not None
    scheduler.record(slot, GARBLED, 0.1)
    again = scheduler.pick(0.1)
    assert again is not None

    scheduler.put_back(again, 0.1)

    third = scheduler.pick(0.1)
    assert third is not None
    assert (key_of(third), third.is_repetition) == ("a", True)


def test_what_was_expedited_keeps_its_hurry_when_it_is_put_back() -> None:
    scheduler = begun(poll("a", every_s=10.0), poll("b", every_s=10.0))
    take(scheduler, 0.0)
    take(scheduler, 0.0)
    scheduler.polls.expedite("b", 3.0)
    scheduler.polls.expedite("b", 3.0)  # does no more than once
    slot = scheduler.pick(3.0)
    assert slot is not None
    scheduler.put_back(slot, 3.0)
    scheduler.polls.expedite("a", 3.0)

    assert {key_of(take(scheduler, 3.0)), key_of(take(scheduler, 3.0))} == {"a", "b"}
    assert scheduler.pick(3.0) is None
