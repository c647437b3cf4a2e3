"""What begins late learns what was said before."""

from __future__ import annotations

from gateway.app.integrations.latest import LatestRecords
from gateway.records import EventRecord, Severity
from tests.sparkplug.support import alarm, availability, info, line, state, value


def test_the_newest_of_each_is_there_with_the_description_first() -> None:
    latest = LatestRecords(lambda: [value("pump", "current", 2.0)])
    for record in (
        state("pump", "ready"),
        state("pump", "running"),
        availability("pump", "online", 1.0),
        info("pump"),
        line({"utilisation": 0.1}),
        line({"utilisation": 0.2}),
        EventRecord("pump", "started", Severity.INFO, "", 1.0, 1),
    ):
        latest.put(record)

    first, *others = latest.records()

    assert first == info("pump")
    assert others == [
        state("pump", "running"),
        availability("pump", "online", 1.0),
        value("pump", "current", 2.0),
        line({"utilisation": 0.2}),
    ]


def test_an_alarm_is_there_until_it_is_cleared() -> None:
    latest = LatestRecords(tuple)
    latest.put(alarm("pump", "e03"))
    latest.put(alarm("pump", "e04"))

    latest.put(alarm("pump", "e03", is_active=False))

    assert list(latest.records()) == [alarm("pump", "e04")]


def test_what_is_gone_is_forgotten() -> None:
    latest = LatestRecords(tuple)
    latest.put(state("pump", "ready"))
    latest.put(line({}))

    latest.forget(["pump", "other"])
    latest.forget_line("hall")
    latest.forget_line("other")

    assert list(latest.records()) == []
