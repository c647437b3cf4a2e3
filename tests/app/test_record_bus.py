"""Where records go: to all subscribers that name their kind, whatever one of them does."""

from __future__ import annotations

from typing import Any

import pytest

from gateway import contract
from gateway.app.record_log import RecordLog, log_failure
from gateway.contract import (
    EventRecord,
    Record,
    RecordWriter,
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
from gateway.starters import Policy
from gateway.system.clock import SystemClock

EVENT = EventRecord(starter="", code="a", severity=Severity.INFO, text="", time_s=0.0, seq=1)


class Subscriber:
    def __init__(self, *takes: type[Record], bug: bool = False) -> None:
        self.takes, self.bug = takes or (Record,), bug
        self.seen: list[Record] = []

    def put(self, record: Record) -> None:
        if self.bug:
            raise RuntimeError("a bug")
        self.seen.append(record)


def test_a_subscriber_gets_the_kinds_that_it_names_whatever_fails_in_another(
    caplog: pytest.LogCaptureFixture,
) -> None:
    broken, events, results = (
        Subscriber(EventRecord, bug=True),
        Subscriber(EventRecord),
        Subscriber(ResultRecord),
    )
    records = RecordWriter(SystemClock(), log_failure)
    records.connect(broken, events, results)

    records.put(EVENT)

    assert (events.seen, results.seen) == ([EVENT], [])
    assert "subscriber=Subscriber" in caplog.text


@pytest.mark.parametrize("subscriber", [Policy, RecordLog])
def test_a_subscriber_names_exactly_the_kinds_that_it_handles(subscriber: Any) -> None:
    assert handled_in(subscriber.put) == set(subscriber.takes)


def test_the_history_takes_what_its_parts_handle_but_not_what_it_makes_itself() -> None:
    handled = set[type]().union(*(handled_in(part.put) for part in (MotorValues, MotorStarts, MotorTrips)))

    assert handled - {StartRecord, TripRecord} | {ValueRecord} == set(History.takes)  # values: its series


def handled_in(method: Any) -> set[type]:
    kinds = [each for each in vars(contract).values() if isinstance(each, type) and issubclass(each, Record)]
    return {kind for kind in kinds if kind.__name__ in method.__code__.co_names}
