from __future__ import annotations

import asyncio
import inspect
import json
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, get_args

import pytest
from jsonschema import Draft7Validator

from gateway.app.capacity import computed_of, prospects_of
from gateway.history.start_record import (
    COLUMNS,
    Cause,
    QuantityChange,
    StartOutcome,
    StartSamples,
    StartSource,
    StartSummary,
    start_to_dict,
)
from gateway.history.trip_record import TripSnapshot
from gateway.mqtt.contract import commands
from gateway.mqtt.contract.payloads import GatewayInfo, Message, Payloads
from gateway.mqtt.contract.topics import Topics
from gateway.records import (
    AlarmRecord,
    AuditRecord,
    AvailabilityRecord,
    EventRecord,
    InfoRecord,
    LineRecord,
    LockRecord,
    Phase,
    Quality,
    Record,
    ResultRecord,
    Severity,
    StartRecord,
    StateRecord,
    TripRecord,
    ValueRecord,
    rfc3339,
)
from gateway.starters.policy.rights import Operator
from tests import plant_rig
from tests.mqtt.outboxes import outbox
from tests.reference.asyncapi import payload_schema
from tests.reference.event_codes import EVENTS
from tests.reference.fields import Field
from tests.reference.topics import TOPICS, Topic
from tests.starters.rig import virtually

BY_NAME = {topic.name: topic for topic in TOPICS}
T = 1_795_222_923.456
LOCK = LockRecord("alice", T, "bearing", "Alice")
PAYLOADS = Payloads(Topics("b"), "run-1")

START = StartSummary(
    *("1", T, "run-1", 1, StartOutcome.FULL_VOLTAGE, Cause(StartSource.COMMAND, "alice", "c1")),
    **{each.name: 1.5 for each in fields(StartSummary) if each.type == "float | None"},
    outliers=2,
    drift={"peak_a": QuantityChange(1.0, 2.0, 100.0)},
)
SAMPLES = StartSamples((0.0,), dict.fromkeys(COLUMNS, (1.0,)))
TRIP = TripSnapshot("1", rfc3339(T), "run-1", 1, "e05", "x", "running", thinned="y")

RECORDS: tuple[tuple[str, Record], ...] = (
    ("starterValue", ValueRecord("p", "x", 1.5, "A", Quality.GOOD, T, 1, label="on", reason="why")),
    ("starterState", StateRecord("p", "ready", Quality.GOOD, T, 1, {"running": False}, LOCK, "why", 5)),
    ("starterAvailability", AvailabilityRecord("p", "online", T, None)),
    (
        "starterAlarm",
        AlarmRecord(
            "p", "E1", is_active=True, severity="fault", text="x", time_s=T, cleared_s=T, count=1, seq=1
        ),
    ),
    (
        "starterInfo",
        InfoRecord(
            *("p", "ssw07", "SSW-07", "1.4", "7", "hall", 1),
            points={
                "current": {
                    "code": "P003",
                    "name": "x",
                    "meaning": "y",
                    "unit": "A",
                    "type": "float",
                    "enum": None,
                    "deadband": 0.5,
                }
            },
            commands=("start",),
            hardware="1",
            rated_current_a=85.0,
            rating="x",
            slot=1,
            accessories=("a", "b"),
        ),
    ),
    ("starterEvent", EventRecord("p", "started", Severity.INFO, "x", T, 1)),
    ("gatewayEvent", EventRecord("", "gap", Severity.WARNING, "x", T, 1, {"count": 1})),
    (
        "result",
        ResultRecord("p", "alice", "1", "read", Phase.CONFIRMED, "ok", "x", T, values={"value": 1.0}),
    ),
    ("starterStart", StartRecord("p", "1", start_to_dict(START, SAMPLES))),
    ("starterTrip", TripRecord("p", "1", TRIP.to_dict())),
    ("audit", AuditRecord("p", "alice", None, "stop", {}, "confirmed", "ok", T, 1, source="web")),
)
LISTED = {code: event for events in EVENTS.values() for code, event in events.items()}
LOOSE = {"result", "lineStatistics"}  # whose further fields depend on the verb, or on the line


def problems(name: str, payload: bytes) -> list[str]:
    schema = payload_schema(BY_NAME[name], is_closed=True)
    errors = Draft7Validator(schema).iter_errors(json.loads(payload))
    return [f"{name} {'.'.join(map(str, error.path))}: {error.message}" for error in errors]


def required(topic: Topic) -> set[str]:
    return {name for name, field in topic.fields.items() if not field.may_be_absent}


def assert_documented(name: str, message: Message) -> None:
    fields = set(json.loads(message.payload))
    assert problems(name, message.payload) == []
    if name not in LOOSE:
        assert set(BY_NAME[name].fields) - fields == set()  # documented, but not there
    assert (message.qos, message.retain) == (BY_NAME[name].qos, BY_NAME[name].is_retained)


@pytest.mark.parametrize(("name", "record"), RECORDS, ids=[name for name, _ in RECORDS])
def test_a_record_has_all_fields_that_the_page_says_and_no_others(name: str, record: Record) -> None:
    assert_documented(name, PAYLOADS.message(record))


def test_every_kind_of_record_is_looked_at() -> None:
    looked_at = {type(record) for _, record in RECORDS} | {LineRecord}  # that one beside a line

    assert set(get_args(Record)) - looked_at == set()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("gatewayStatus", PAYLOADS.status("online", time_s=T, since_s=T, reason=None)),
        ("gatewayStatus", PAYLOADS.status("offline", time_s=None, since_s=None, reason="lost")),
        ("gatewayFresh", PAYLOADS.fresh("abc", T)),
        (
            "gatewayInfo",
            PAYLOADS.gateway_info(
                GatewayInfo(
                    "0.2.0",
                    ("p",),
                    ("hall",),
                    (Operator("alice", ("start",), ("*",), freshness="token"),),
                    groups={"all": ("p",)},
                    mqtt_version="5",
                )
            ),
        ),
        ("outbox", PAYLOADS.outbox(outbox().statistics(0.0))),
        (
            "starterHistory",
            PAYLOADS.history(
                "b/starter/p/history",
                ['{"point":"x","value":1.0,"quality":"good","time":null,"seq":1}'],
                "run-1",
            ),
        ),
    ],
    ids=["status", "will", "fresh", "info", "outbox", "history"],
)
def test_a_message_of_the_gateway_has_all_fields_that_the_page_says(name: str, message: Message) -> None:
    assert_documented(name, message)


def test_the_page_has_every_topic_of_the_contract_and_no_others() -> None:
    topics = Topics("b")
    fixed = {value for name, value in vars(topics).items() if name.startswith(("gateway_", "audit"))}
    built = {
        method(topics, *list(inspect.signature(method).parameters)[1:])
        for name, method in inspect.getmembers(Topics, inspect.isfunction)
        if not name.startswith(("_", "parse_")) and name != "starter"
    }

    assert fixed | built == {f"b/{topic.address}".translate({ord(c): "" for c in "{}"}) for topic in TOPICS}


def test_a_command_may_have_the_fields_that_the_page_says_and_no_others() -> None:
    assert set(BY_NAME["command"].fields) == set(commands._Body.model_fields)


@virtually
async def test_everything_that_a_plant_publishes_is_as_the_page_says() -> None:
    async with plant_rig.running() as here:
        statistics_of = {name: line.statistics() for name, line in here.plant.lines.items()}
        here.unit("hall", 1).trip(5)
        await asyncio.sleep(30)
        records = list(here.sink.records)
        computed = {line.table.name: computed_of(line) for line in prospects_of(here.config)}
    found = {type(record).__name__ for record in records}
    names = {type(record): name for name, record in RECORDS}  # events have the same fields everywhere

    assert {"ValueRecord", "StateRecord", "AvailabilityRecord", "InfoRecord", "AlarmRecord"} <= found
    assert "TripRecord" in found
    events = [record for record in records if isinstance(record, EventRecord)]
    assert {"fault", "readiness"} <= {event.code for event in events}
    assert [event.code for event in events if not set(event.data) <= set(LISTED[event.code].fields)] == []
    assert "before" in next(event.data for event in events if event.code == "fault")
    wrong = [
        problem
        for record in records
        for problem in problems(names[type(record)], PAYLOADS.message(record).payload)
    ]
    assert wrong[:5] == []
    lag_s = {"line": 0.001, "gateway": 0.001}
    for name, statistics in statistics_of.items():
        whole = {**statistics, "computed": computed[name], "lag_s": lag_s}
        assert problems("lineStatistics", PAYLOADS.message(LineRecord(name, whole)).payload) == []
        assert missing("lineStatistics", whole) == {
            "uart_errors",
            "crashes",
            "cable",
        }  # of a real port, and of a line in a thread


def missing(name: str, payload: Mapping[str, Any]) -> set[str]:
    return set(BY_NAME[name].fields) - set(payload)


def described(fields: Mapping[str, Field], path: str = "") -> list[str]:
    bare = [f"{path}{name}" for name, field in fields.items() if not field.meaning]
    return bare + [
        each for name, field in fields.items() for each in described(field.inside, f"{path}{name}.")
    ]


def test_every_field_has_a_meaning_and_a_number_of_seconds_its_unit() -> None:
    for topic in TOPICS:
        assert described(topic.fields) == []
        assert {field.unit for name, field in topic.fields.items() if name.endswith("_s")} <= {"s", ""}
