"""Where records go: to all subscribers, in one order, whatever one of them does."""

from __future__ import annotations

from typing import Any

import pytest

from gateway import contract
from gateway.app.record_log import RecordLog, log_failure
from gateway.contract import (
    EventRecord,
    Record,
    RecordBus,
    ResultRecord,
    Severity,
    StartRecord,
    TripRecord,
    ValueRecord,
)
from gateway.plugins.history.plugin import History
from gateway.plugins.history.starts import MotorStarts
from gateway.plugins.history.trips import MotorTrips
from gateway.plugins.history.values import MotorValues
from gateway.starters import Policy, StarterServices


class Subscriber:
    def __init__(self, name: str, seen: list[tuple[str, str]]) -> None:
        self.name, self.seen = name, seen

    def put(self, record: Record) -> None:
        assert isinstance(record, EventRecord)
        self.seen.append((self.name, record.code))


class Results(Subscriber):
    takes = (ResultRecord,)


class Broken:
    def put(self, record: Record) -> None:
        raise RuntimeError("a bug")


def event(code: str) -> EventRecord:
    return EventRecord(starter="", code=code, severity=Severity.INFO, text="", time_s=0.0, seq=1)


def test_a_subscriber_gets_only_the_kinds_that_it_names() -> None:
    bus, seen = RecordBus(log_failure), list[tuple[str, str]]()
    bus.put(event("early"))
    bus.connect(Results("results", seen), Subscriber("all", seen))

    bus.put(event("late"))

    assert seen == [("all", "early"), ("all", "late")]


@pytest.mark.parametrize("subscriber", [Policy, RecordLog, StarterServices])
def test_a_subscriber_names_exactly_the_kinds_that_it_handles(subscriber: Any) -> None:
    assert handled_in(subscriber.put) == set(subscriber.takes)


def test_the_history_takes_what_its_parts_handle_but_not_what_it_makes_itself() -> None:
    handled = set[type]().union(*(handled_in(part.put) for part in (MotorValues, MotorStarts, MotorTrips)))

    assert handled - {StartRecord, TripRecord} | {ValueRecord} == set(History.takes)  # values: its series


def handled_in(method: Any) -> set[type]:
    kinds = [each for each in vars(contract).values() if isinstance(each, type) and issubclass(each, Record)]
    return {kind for kind in kinds if kind.__name__ in method.__code__.co_names}


def test_a_subscriber_that_fails_keeps_nothing_from_the_others(caplog: pytest.LogCaptureFixture) -> None:
    bus, seen = RecordBus(log_failure), list[tuple[str, str]]()
    bus.connect(Broken(), Subscriber("second", seen))

    bus.put(event("a"))

    assert seen == [("second", "a")]
    assert "subscriber=Broken" in caplog.text
