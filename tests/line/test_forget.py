"""A unit that is gone, or whose place another has taken: nothing of it is remembered."""

from __future__ import annotations

from gateway.line.rtu.outcome import Answered, Silent
from gateway.line.scheduler.requests import Slot
from gateway.line.scheduler.scheduler import Scheduler
from gateway.line.scheduler.units import UnitState
from gateway.line.statistics import Statistics
from tests.line.fakes import poll

SILENT = Silent()


def silenced(scheduler: Scheduler) -> None:
    """Let the unit of the only poll go silent."""
    now_s = 0.0
    while scheduler.polls.unit(1).state is not UnitState.SILENT:
        slot = scheduler.pick(now_s)
        if slot is not None:
            scheduler.record(slot, SILENT, now_s)
        now_s += 0.1


def test_who_takes_a_silent_units_place_is_asked_at_once_and_is_news() -> None:
    scheduler = Scheduler([poll("a")])
    scheduler.polls.begin(0.0)
    silenced(scheduler)

    scheduler.polls.remove("a")
    scheduler.polls.forget(1)
    scheduler.polls.add(poll("b"), 100.0)
    slot = scheduler.pick(100.0)

    assert slot is not None
    assert slot.poll is not None
    assert slot.poll.key == "b"
    assert scheduler.polls.unit(1).state is UnitState.NEW
    assert scheduler.record(slot, Answered((), at_s=100.1, response_time_s=0.01), 100.1).is_answering is True


def test_the_watchdog_of_a_forgotten_unit_asks_for_no_request() -> None:
    scheduler = Scheduler([poll("a")])
    scheduler.polls.begin(0.0)
    scheduler.polls.set_deadline(1, 4.0)
    first = scheduler.pick(0.0)
    assert first is not None
    scheduler.record(first, Answered((), at_s=0.1, response_time_s=0.01), 0.1)

    scheduler.polls.remove("a")
    scheduler.polls.forget(1)

    assert scheduler.pick(1000.0) is None


def test_what_was_counted_of_a_unit_is_dropped_with_it() -> None:
    statistics = Statistics()
    statistics.begin(0.0)
    read = poll("a")
    slot = Slot(1, read.request, read.response_time_s, 0.0, poll=read)
    statistics.note(slot, Answered((), at_s=0.1, response_time_s=0.01), took_s=0.02, now_s=0.1)

    statistics.forget(1)
    payload = statistics.to_dict([read], worst_stop_latency_s=0.1, now_s=0.2)
    assert (payload["units"], payload["answered"], payload["sweep_s"]) == ({}, 1, 0.02)

    assert statistics.to_dict([], worst_stop_latency_s=0.1, now_s=0.2)["sweep_s"] == 0.0
    assert statistics.to_dict([read], worst_stop_latency_s=0.1, now_s=0.2)["sweep_s"] == 0.0
