"""What the page holds besides the newest records, and what a client that has seen a part of it is sent."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

from gateway.contract import (
    AuditRecord,
    EventRecord,
    Latest,
    Phase,
    Quality,
    Record,
    ResultRecord,
    Severity,
    ValueRecord,
)
from gateway.plugins.web.acknowledged import Acknowledged
from gateway.plugins.web.site_model import MOST_COMMANDS, MOST_MESSAGES, SiteModel
from gateway.store import Documents
from tests.contract.examples import START
from tests.web.support import web_settings


class Shown(SiteModel):
    """A model with its own `Latest`, fed as the gateway feeds both."""

    def __init__(self) -> None:
        gateway = cast("Any", SimpleNamespace(latest=Latest(), documents=Documents()))
        super().__init__(web_settings(), gateway.latest, Acknowledged(gateway))

    def take(self, *records: Record) -> None:
        for record in records:
            self.latest.put(record)
            self.put(record)


def value(point: str, number: float = 1.0, starter: str = "pump-1") -> ValueRecord:
    return ValueRecord(
        starter=starter, point=point, value=number, unit="A", quality=Quality.GOOD, time_s=1.0, seq=1
    )


def event(code: str = "lag", starter: str = "") -> EventRecord:
    return EventRecord(starter=starter, seq=1, time_s=1.0, code=code, severity=Severity.INFO, text="")


def result(phase: Phase, id_: str | None = "a", starter: str = "pump-1", verb: str = "stop") -> ResultRecord:
    named: Any = {"starter": starter, "client": "alice", "id": id_, "verb": verb}
    return ResultRecord(**named, phase=phase, code="ok", text="", time_s=1.0)


def decided(decision: str, id_: str | None = "a") -> AuditRecord:
    named: Any = {"starter": "pump-1", "client": "alice", "id": id_, "verb": "stop", "args": {"n": 1}}
    return AuditRecord(**named, seq=1, time_s=1.0, decision=decision, code="", operator=None, source="web")


def test_a_client_that_has_missed_messages_gets_none_and_is_sent_the_whole_again() -> None:
    model = Shown()
    model.take(event())
    seen = model.now.happened
    model.take(*[event()] * MOST_MESSAGES)

    assert len(model.messages(None, seen) or ()) == MOST_MESSAGES
    model.take(event())
    assert model.messages(None, seen) is None
    assert model.messages(None, model.now.happened) == []
    assert len(model.messages(None) or ()) == MOST_MESSAGES


def test_results_and_starts_are_sent_as_they_come_and_results_in_a_starters_snapshot() -> None:
    model = Shown()
    seen = model.now.happened
    start = replace(START, starter="pump-1")
    model.take(result(Phase.ACCEPTED), result(Phase.ACCEPTED, starter="pump-2"), start)

    assert model.messages("pump-1", seen) == [
        result(Phase.ACCEPTED),
        result(Phase.ACCEPTED, starter="pump-2"),
        start,
    ]
    assert start not in (model.messages("pump-2", seen) or ())
    assert model.messages("pump-1") == [result(Phase.ACCEPTED)]
    assert model.messages(None) == []


def test_the_phases_of_a_command_stand_together_with_what_was_asked() -> None:
    model = Shown()
    model.take(result(Phase.ACCEPTED), decided("accepted"), result(Phase.WRITTEN), result(Phase.CONFIRMED))
    model.take(result(Phase.ACCEPTED, "b"), result(Phase.ACCEPTED, starter="absent"))

    first, second = model.commands("pump-1")
    assert [each["phase"] for each in first["phases"]] == ["accepted", "written", "confirmed"]
    assert (first["args"], first["source"]) == ({"n": 1}, "web")
    assert (second["id"], second["source"]) == ("b", "mqtt")
    assert model.commands("absent") == []


def test_a_stop_without_id_is_another_one_once_the_last_is_over() -> None:
    model = Shown()
    model.take(decided("accepted", None), result(Phase.ACCEPTED, None), result(Phase.CONFIRMED, None))
    model.take(decided("rejected", None), result(Phase.ACCEPTED, None))

    assert [len(each["phases"]) for each in model.commands("pump-1")] == [2, 1]


def test_the_latest_commands_are_shown_until_a_reload_takes_their_starter_away() -> None:
    model = Shown()
    model.take(*(result(Phase.ACCEPTED, str(n)) for n in range(MOST_COMMANDS + 3)), value("current"))

    assert model.commands("pump-1")[0]["id"] == "3"
    model.reconfigure(web_settings("pump-2"))
    assert model.commands("pump-1") == []
