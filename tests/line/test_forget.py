"""A unit that is gone, or whose place another has taken: nothing of it is remembered."""

from __future__ import annotations

from gateway.line.rtu.outcome import Answered, Silent
from gateway.line.rtu.response_time import ENOUGH, ResponseTimeEstimator
from gateway.line.scheduler.requests import Slot
from gateway.line.scheduler.scheduler import Scheduler
from gateway.line.scheduler.units import UnitState
from gateway.line.statistics import Statistics
from tests.line.fakes import poll

SILENT = Silent()
LIMIT_S = 0.1


def silenced(plan: Scheduler) -> None:
    """Let the unit of the only poll go silent."""
    now_s = 0.0
    while plan.polls.state_of(1) is not UnitState.SILENT:
        turn = plan.pick(now_s)
        if turn is not None:
            plan.record(turn, SILENT, now_s)
        now_s += 0.1


def test_who_takes_a_silent_units_place_is_asked_at_once_and_is_news() -> None:
    plan = Scheduler([poll("a")])
    plan.begin(0.0)
    silenced(plan)

    plan.polls.remove("a")
    plan.polls.forget(1)
    plan.polls.add(poll("b"), 100.0)
    turn = plan.pick(100.0)

    assert turn is not None
    assert turn.poll is not None
    assert turn.poll.key == "b"
    assert plan.polls.state_of(1) is UnitState.NEW
    assert plan.record(turn, Answered((), at_s=100.1, response_time_s=0.01), 100.1).is_answering is True


def test_a_unit_that_still_has_polls_is_not_forgotten() -> None:
    plan = Scheduler([poll("a")])
    plan.begin(0.0)
    silenced(plan)

    plan.polls.forget(1)
    plan.polls.forget(99)  # nor is one that nobody knows

    assert plan.polls.state_of(1) is UnitState.SILENT


def test_the_watchdog_of_a_forgotten_unit_has_nobody_asked() -> None:
    plan = Scheduler([poll("a")])
    plan.begin(0.0)
    plan.polls.set_deadline(1, 4.0)
    first = plan.pick(0.0)
    assert first is not None
    plan.record(first, Answered((), at_s=0.1, response_time_s=0.01), 0.1)

    plan.polls.remove("a")
    plan.polls.forget(1)

    assert plan.pick(1000.0) is None


def test_what_was_learnt_and_counted_of_a_unit_is_dropped_with_it() -> None:
    figures = Statistics()
    figures.begin(0.0)
    read = poll("a")
    turn = Slot(1, read.request, read.response_time_s, 0.0, poll=read)
    figures.note(turn, Answered((), at_s=0.1, response_time_s=0.01), took_s=0.02, now_s=0.1)

    figures.forget(1)
    told = figures.to_dict([read], worst_stop_latency_s=0.1, now_s=0.2)
    assert (told["units"], told["answered"], told["sweep_s"]) == ({}, 1, 0.02)

    assert figures.to_dict([], worst_stop_latency_s=0.1, now_s=0.2)["sweep_s"] == 0.0
    assert figures.to_dict([read], worst_stop_latency_s=0.1, now_s=0.2)["sweep_s"] == 0.0


def test_a_forgotten_unit_is_waited_for_as_long_as_it_may_take() -> None:
    learnt = ResponseTimeEstimator()
    for _ in range(ENOUGH):
        learnt.note_answer(1, 3, 0.01)
    learnt.note_miss(2)
    assert learnt.response_time_s(1, 3, limit_s=LIMIT_S, floor_s=0.005) < LIMIT_S

    learnt.forget(1)
    learnt.forget(2)

    assert learnt.response_time_s(1, 3, limit_s=LIMIT_S, floor_s=0.005) == LIMIT_S
    assert learnt.quantiles(1) == {"p50": None, "p99": None}
