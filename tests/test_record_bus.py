"""Where records go: to all subscribers, in one order, whatever one of them does."""

from __future__ import annotations

import pytest

from gateway.app.record_bus import RecordBus
from gateway.records import EventRecord, Record, Severity


class Subscriber:
    def __init__(self, name: str, seen: list[tuple[str, str]]) -> None:
        self.name, self.seen = name, seen

    def put(self, record: Record) -> None:
        assert isinstance(record, EventRecord)
        self.seen.append((self.name, record.code))


class Broken:
    def put(self, record: Record) -> None:
        raise RuntimeError("a bug")


def event(code: str) -> EventRecord:
    return EventRecord("", code, Severity.INFO, "", 0.0, 1)


def test_every_subscriber_gets_every_record_in_the_order_of_subscription() -> None:
    bus, seen = RecordBus(), list[tuple[str, str]]()
    bus.connect(Subscriber("first", seen), Subscriber("second", seen))

    bus.put(event("a"))
    bus.put(event("b"))

    assert seen == [("first", "a"), ("second", "a"), ("first", "b"), ("second", "b")]


def test_what_was_put_before_there_were_subscribers_reaches_them_first() -> None:
    bus, seen = RecordBus(), list[tuple[str, str]]()
    bus.put(event("early"))

    bus.connect(Subscriber("only", seen))
    bus.put(event("late"))

    assert seen == [("only", "early"), ("only", "late")]


def test_a_subscriber_that_fails_keeps_nothing_from_the_others(caplog: pytest.LogCaptureFixture) -> None:
    bus, seen = RecordBus(), list[tuple[str, str]]()
    bus.connect(Broken(), Subscriber("second", seen))

    bus.put(event("a"))

    assert seen == [("second", "a")]
    assert "subscriber=Broken" in caplog.text
