"""Jobs and repetitions among the polls."""

from __future__ import annotations

from math import inf

from gateway.line.rtu.outcome import Garbled, Silent
from gateway.line.scheduler.job_queue import JOBS_BURST_S, JOBS_SHARE, OLDEST_EVERY
from gateway.line.scheduler.requests import Priority
from gateway.line.scheduler.scheduler import Verdict
from gateway.line.scheduler.units import UnitState
from tests.line.fakes import poll
from tests.line.planned import ANSWERED, GARBLED, READ, WRITE, begun, job, key_of, take


def test_jobs_come_before_polls_and_lanes_in_their_order() -> None:
    plan = begun(poll("a", every_s=0.0))
    take(plan, 0.0)
    jobs = {lane: job(lane) for lane in reversed(Priority)}
    for waiting in jobs.values():
        plan.jobs.submit(waiting, 0.0)

    assert plan.next_due_s() == -inf
    turns = [take(plan, 0.0) for _ in range(6)]

    assert [turn.job for turn in turns if turn] == [jobs[lane] for lane in sorted(Priority)] + [None]


def test_every_units_first_poll_waits_for_stops_and_commands_only() -> None:
    plan = begun(poll("a"), poll("b", unit=2), poll("c"))
    jobs = {lane: job(lane, unit=99) for lane in Priority}
    for waiting in jobs.values():
        plan.jobs.submit(waiting, 0.0)

    turns = [take(plan, 0.0) for _ in range(8)]

    assert [key_of(turn) or (turn and turn.job) for turn in turns] == [
        *(jobs[Priority.STOP], jobs[Priority.FOLLOW_UP], jobs[Priority.COMMAND], "a", "b"),
        *(jobs[Priority.READ_BACK], jobs[Priority.PARAMETERS]),
        "c",
    ]


def test_jobs_use_what_they_have_saved_up_and_then_every_other_slot() -> None:
    plan = begun(poll("a", every_s=0.0))
    take(plan, 0.0)
    for _ in range(60):
        plan.jobs.submit(job(), 0.0)

    now_s, kinds = 0.0, ""
    for _ in range(60):
        turn = plan.pick(now_s)
        assert turn is not None
        kinds += "p" if turn.job is None else "j"
        now_s += 0.05
        plan.record(turn, ANSWERED, now_s)

    saved = round(JOBS_BURST_S / JOBS_SHARE / 0.05)
    assert kinds[: saved - 1] == "j" * (saved - 1)
    assert kinds[saved + 2 :] in ("jp" * 60, "pj" * 60) or kinds[saved + 2 :] in "jp" * 60


def test_every_fourth_job_is_the_oldest_that_waits() -> None:
    plan = begun()
    old = job(Priority.PARAMETERS)
    plan.jobs.submit(old, 0.0)
    for _ in range(10):
        plan.jobs.submit(job(), 1.0)

    turns = [take(plan, 1.0) for _ in range(11)]

    assert [turn.job for turn in turns if turn].index(old) == OLDEST_EVERY - 1


def test_jobs_go_on_while_no_poll_is_due() -> None:
    plan = begun(poll("a", every_s=10.0))
    take(plan, 0.0)
    for _ in range(40):
        plan.jobs.submit(job(), 0.0)

    assert all(take(plan, 1.0) for _ in range(40))


def test_a_stop_overtakes_an_overdue_poll_however_many_jobs_there_were() -> None:
    plan = begun(poll("a", every_s=0.0))
    for _ in range(10):
        plan.jobs.submit(job(Priority.STOP), 0.0)

    turns = [take(plan, 0.0) for _ in range(11)]

    assert [turn is not None and turn.job is not None for turn in turns] == [True] * 10 + [False]


def test_a_waiting_job_can_be_withdrawn_and_one_under_way_cannot() -> None:
    plan = begun()
    first, second = job(), job()
    plan.jobs.submit(first, 0.0)
    plan.jobs.submit(second, 0.0)

    assert plan.jobs.withdraw(second)
    assert not plan.jobs.withdraw(second)
    plan.pick(0.0)
    assert not plan.jobs.withdraw(first)
    assert plan.pick(0.0) is None


def test_all_waiting_jobs_can_be_taken_out() -> None:
    plan = begun()
    jobs = [job(Priority.READ_BACK), job(Priority.STOP)]
    for waiting in jobs:
        plan.jobs.submit(waiting, 0.0)

    assert plan.jobs.clear() == (jobs[1], jobs[0])
    assert plan.jobs.clear() == ()


def test_a_garbled_poll_is_repeated_once_at_once_and_counts_when_it_was_no_use() -> None:
    plan = begun(poll("a"), poll("b"))
    first = plan.pick(0.0)
    assert first is not None
    assert plan.record(first, GARBLED, 0.1) == Verdict(is_final=False)
    assert plan.polls.state_of(1) is UnitState.NEW

    second = plan.pick(0.1)

    assert second is not None
    assert key_of(second) == "a"
    assert second.is_repetition
    assert plan.record(second, GARBLED, 0.2) == Verdict(is_final=True)
    assert plan.polls.state_of(1) is UnitState.SUSPECT
    third = plan.pick(0.2)
    assert third is not None
    assert (key_of(third), third.is_repetition) == ("b", False)


def test_a_poll_whose_outcome_is_open_is_asked_again_at_once_as_often_as_needed() -> None:
    plan = begun(poll("a", every_s=1.0), poll("b", every_s=1.0))

    for now_s in (0.0, 0.1, 0.2):
        turn = plan.pick(now_s)
        assert turn is not None
        assert key_of(turn) == "a"
        assert not turn.is_repetition
        assert not plan.record(turn, ANSWERED, now_s + 0.1, is_open=True).is_final
    assert plan.polls.state_of(1) is UnitState.ANSWERING

    assert [key_of(take(plan, at_s)) for at_s in (0.3, 0.3, 0.9, 1.0, 1.0)] == ["a", "b", None, "a", "b"]


def test_a_corrupted_reply_to_what_was_open_is_repeated_once() -> None:
    plan = begun(poll("a"))
    finals = []
    for outcome, is_open in ((ANSWERED, True), (GARBLED, False), (ANSWERED, True), (GARBLED, False)):
        turn = plan.pick(0.0)
        assert turn is not None
        finals.append(plan.record(turn, outcome, 0.0, is_open=is_open).is_final)

    assert finals == [False, False, False, True]


def test_an_open_answer_to_a_probe_brings_its_unit_back_and_the_probe_is_asked_once_more() -> None:
    plan = begun(poll("a", every_s=1.0), poll("b", every_s=1.0))
    for now_s in (0.0, 0.0):
        take(plan, now_s, Silent())
    assert plan.polls.state_of(1) is UnitState.SILENT
    probe = plan.pick(1.0)
    assert probe is not None

    assert plan.record(probe, ANSWERED, 1.0, is_open=True) == Verdict(is_final=False, is_answering=True)

    assert [key_of(take(plan, 1.0)) for _ in range(3)] == ["a", "b", None]


def test_an_open_poll_that_is_put_back_is_asked_once_more_and_a_removed_one_is_not() -> None:
    plan = begun(poll("a", every_s=1.0), poll("b", every_s=1.0))
    first = plan.pick(0.0)
    assert first is not None
    plan.record(first, ANSWERED, 0.0, is_open=True)
    again = plan.pick(0.0)
    assert again is not None
    plan.put_back(again, 0.3)
    assert [key_of(take(plan, at_s)) for at_s in (0.0, 0.2, 0.3, 0.3)] == ["b", None, "a", None]

    turn = plan.pick(1.0)
    assert turn is not None
    assert key_of(turn) == "b"
    plan.record(turn, ANSWERED, 1.0, is_open=True)
    plan.polls.remove("b")

    assert [key_of(take(plan, 2.1)) for _ in range(2)] == ["a", None]


def test_a_job_whose_outcome_is_open_is_sent_again_before_the_others_of_its_priority() -> None:
    plan = begun()
    read, other = job(Priority.READ_BACK, request=READ), job(Priority.READ_BACK, request=READ)
    plan.jobs.submit(read, 0.0)
    plan.jobs.submit(other, 0.0)

    for is_open in (True, True, False):
        turn = plan.pick(0.0)
        assert turn is not None
        assert turn.job is read
        assert plan.record(turn, ANSWERED, 0.0, is_open=is_open).is_final is not is_open

    turn = take(plan, 0.0)
    assert turn is not None
    assert turn.job is other


def test_time_in_which_a_job_may_not_be_sent_is_not_charged() -> None:
    plan = begun(poll("a", every_s=10.0))
    take(plan, 0.0)
    plan.jobs.submit(job(Priority.READ_BACK, request=READ), 1.0)
    turn = plan.pick(1.0)
    assert turn is not None
    plan.put_back(turn, 2.0)

    turn = plan.pick(2.0)
    assert turn is not None
    plan.record(turn, ANSWERED, 2.1)

    assert plan.jobs.may_pass_polls(2.1)


def test_a_units_first_poll_is_its_probe() -> None:
    plan = begun(poll("a"), poll("b"))

    probe = plan.polls.probe_of(1)

    assert probe is not None
    assert probe.key == "a"
    assert plan.polls.probe_of(2) is None


def test_a_garbled_read_job_is_repeated_before_the_others_of_its_lane() -> None:
    plan = begun()
    read, other = job(Priority.READ_BACK, request=READ), job(Priority.READ_BACK, request=READ)
    plan.jobs.submit(read, 0.0)
    plan.jobs.submit(other, 0.0)

    first = plan.pick(0.0)
    assert first is not None
    assert not plan.record(first, GARBLED, 0.0).is_final
    again = plan.pick(0.0)

    assert again is not None
    assert again.job is read
    assert plan.record(again, GARBLED, 0.0).is_final


def test_a_garbled_write_is_never_repeated() -> None:
    plan = begun()
    plan.jobs.submit(job(request=WRITE), 0.0)

    turn = plan.pick(0.0)

    assert turn is not None
    assert plan.record(turn, GARBLED, 0.0).is_final
    assert plan.pick(0.0) is None


def test_what_was_not_sent_for_noise_is_not_repeated_at_once() -> None:
    plan = begun(poll("a", every_s=1.0))

    turn = plan.pick(0.0)

    assert turn is not None
    assert plan.record(turn, Garbled("noise", b"", is_sent=False), 0.0).is_final
    assert plan.pick(0.0) is None


def test_what_is_put_back_until_its_unit_may_be_asked_lets_others_pass() -> None:
    plan = begun(poll("a"), poll("b", unit=2))
    first, second = job(Priority.READ_BACK), job(Priority.READ_BACK, unit=2)
    turn = plan.pick(0.0)
    assert turn is not None
    plan.put_back(turn, 0.5)
    plan.jobs.submit(first, 0.0)
    plan.jobs.submit(second, 0.0)

    assert key_of(take(plan, 0.0)) == "b"
    taken_back = plan.pick(0.0)
    assert taken_back is not None
    assert taken_back.job is first
    plan.put_back(taken_back, 0.5)

    turns = [take(plan, at_s) for at_s in (0.0, 0.1, 0.5, 0.5)]
    assert [turn and (turn.job or key_of(turn)) for turn in turns] == [second, None, "a", first]


def test_a_removed_poll_that_is_put_back_stays_removed() -> None:
    plan = begun(poll("a"))
    turn = plan.pick(0.0)
    assert turn is not None

    plan.polls.remove("a")
    plan.put_back(turn, 0.5)

    assert plan.next_due_s() == inf


def test_a_poll_that_is_removed_before_its_repetition_is_not_repeated() -> None:
    plan = begun(poll("a"), poll("b"))
    turn = plan.pick(0.0)
    assert turn is not None
    plan.record(turn, GARBLED, 0.1)

    plan.polls.remove("a")

    assert key_of(take(plan, 0.1)) == "b"


def test_a_repetition_that_is_put_back_at_once_is_still_the_next() -> None:
    plan = begun(poll("a"), poll("b"))
    turn = plan.pick(0.0)
    assert turn is not None
    plan.record(turn, GARBLED, 0.1)
    again = plan.pick(0.1)
    assert again is not None

    plan.put_back(again, 0.1)

    third = plan.pick(0.1)
    assert third is not None
    assert (key_of(third), third.is_repetition) == ("a", True)


def test_what_was_hastened_keeps_its_hurry_when_it_is_put_back() -> None:
    plan = begun(poll("a", every_s=10.0), poll("b", every_s=10.0))
    take(plan, 0.0)
    take(plan, 0.0)
    plan.polls.expedite("b", 3.0)
    plan.polls.expedite("b", 3.0)  # does no more than once
    turn = plan.pick(3.0)
    assert turn is not None
    plan.put_back(turn, 3.0)
    plan.polls.expedite("a", 3.0)

    assert {key_of(take(plan, 3.0)), key_of(take(plan, 3.0))} == {"a", "b"}
    assert plan.pick(3.0) is None
