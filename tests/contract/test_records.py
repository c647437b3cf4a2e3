"""Records are their payloads, both ways: one example of each form, what is none, and the newest ones."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from gateway.contract import (
    ForgetRecord,
    HistoryRecord,
    InfoRecord,
    Latest,
    LineRecord,
    LockRecord,
    Phase,
    Quality,
    Record,
    ResultRecord,
    StartRecord,
    StateRecord,
    ValueRecord,
    history_item,
    read_record,
    read_stored,
)
from tests.contract.examples import START

VALUE = ValueRecord(
    starter="pump", point="p003", value=12.0, unit="A", quality=Quality.GOOD, time_s=1.5, seq=7, boot="b"
)
STATE = StateRecord(
    starter="pump",
    state="running",
    quality=Quality.GOOD,
    time_s=2.0,
    seq=8,
    boot="b",
    lock=LockRecord(by="alice", since_s=0.0, reason="work"),
    flags={"running": True, "state": False},
)
RESULT = ResultRecord(
    starter="pump",
    client="alice",
    id="1",
    verb="read",
    phase=Phase.CONFIRMED,
    code="ok",
    text="read",
    time_s=0.0,
    values={"value": 3.0, "id": "another"},
    correlation=b"x",
)

INFO = InfoRecord(
    starter="pump",
    family="ssw07",
    model=None,
    firmware="1.3",
    serial=None,
    line="hall",
    address=1,
    points={"p002": {"unit": "A", "deadband": 0.5}},
    commands=("start", "stop"),
)

ROWS = [
    (
        VALUE,
        "starter/pump/value/p003",
        '{"value":12.0,"unit":"A","quality":"good","time":"1970-01-01T00:00:01.500Z","seq":7,"boot":"b"}',
    ),
    (
        replace(VALUE, point="P.003", value=2, label="local", reason="why"),
        "starter/pump/value/p_003",
        '{"value":2,"unit":"A","quality":"good","time":"1970-01-01T00:00:01.500Z","seq":7,"boot":"b",'
        '"label":"local","reason":"why"}',
    ),
    (
        STATE,
        "starter/pump/state",
        '{"state":"running","quality":"good","time":"1970-01-01T00:00:02.000Z","seq":8,"boot":"b",'
        '"locked":{"by":"alice","operator":null,"since":"1970-01-01T00:00:00.000Z","reason":"work",'
        '"notice":"replaces no physical lock"},"running":true}',
    ),
    (
        RESULT,
        "result/pump/alice",
        '{"id":"1","verb":"read","phase":"confirmed","code":"ok","text":"read",'
        '"time":"1970-01-01T00:00:00.000Z","duplicate":false,"value":3.0}',
    ),
    (LineRecord(line="hall", data={"polls": 1, "load": 0.5}), "gateway/line/hall", '{"polls":1,"load":0.5}'),
    (
        HistoryRecord(starter="pump", boot="b", items=[history_item(VALUE)]),
        "starter/pump/history",
        '{"boot":"b","items":[{"point":"p003","value":12.0,"quality":"good",'
        '"time":"1970-01-01T00:00:01.500Z","seq":7}]}',
    ),
    (
        INFO,
        "starter/pump/info",
        '{"family":"ssw07","model":null,"firmware":"1.3","serial":null,"hardware":null,"rated_current_a":null,'
        '"rating":null,"slot":null,"accessories":null,"line":"hall","address":1,'
        '"points":{"p002":{"unit":"A","deadband":0.5}},"commands":["start","stop"]}',
    ),
    (
        START,
        "starter/pump/start",
        '{"id":"b-11","time":"1970-01-01T00:00:00.000Z","boot":"b","seq":11,'
        '"cause":{"source":"command","client":"alice","command_id":"1"},"outcome":"full_voltage",'
        '"acceleration_s":8.1235,"is_baseline":false,"samples":{"t_s":[-1.0,0.5],"current":[null,310.0]}}',
    ),
]

WHOLE = (
    b'{"id":"1","verb":"read","phase":"confirmed","code":"ok","text":"","time":"2026-11-21T01:02:03.456Z",'
    b'"duplicate":true,"value":3.0,"correlation":"x","starter":"fan"}'
)


@pytest.mark.parametrize(("record", "topic", "payload"), ROWS)
def test_a_record_is_its_payload(record: Record, topic: str, payload: str) -> None:
    assert record.topic == topic
    assert record.payload().decode() == payload


def test_only_the_one_final_result_of_a_command_has_a_name() -> None:
    assert RESULT.key == "alice/1"
    assert replace(RESULT, is_duplicate=True).key == ""
    assert replace(RESULT, phase=Phase.WRITTEN).key == ""


def test_the_newest_records_are_numbered_and_what_is_forgotten_leaves_its_topic() -> None:
    latest = Latest()
    for record in (VALUE, RESULT, STATE, INFO, replace(VALUE, value=13.0)):
        latest.put(record)
    seen = latest.number

    assert latest.find("starter/pump/value/p003") == replace(VALUE, value=13.0)
    assert [topic for topic, _ in latest.newer_than(seen - 1)] == ["starter/pump/value/p003"]
    latest.put(ForgetRecord(starters=("pump",)))
    assert {record for _, record in latest.newer_than(seen)} == {None}


def test_while_no_consumer_is_there_no_record_is_held_and_the_first_one_gets_all_of_them() -> None:
    latest = Latest(lambda: [VALUE, INFO])

    latest.put(STATE)  # which the other holds, too
    held_before = list(latest.newer_than(0))
    latest.begin()
    latest.put(newer := replace(VALUE, value=13.0))

    assert held_before == []
    assert [record for _, record in latest.newer_than(0)] == [newer, INFO]


def read(payload: bytes) -> ResultRecord:
    return read_record(ResultRecord, payload, starter="pump", client="alice")


def test_own_fields_are_typed_and_all_others_stand_beside_them() -> None:
    record = read(WHOLE)

    assert (record.phase, record.is_duplicate, record.starter) == (Phase.CONFIRMED, True, "pump")
    assert (record.time_s, record.correlation) == (1795222923.456, None)
    assert record.values == {"value": 3.0, "correlation": "x", "starter": "fan"}


def test_a_time_that_is_not_known_stays_null() -> None:
    record = read(WHOLE.replace(b'"2026-11-21T01:02:03.456Z"', b"null"))

    assert b'"time":null' in record.payload()


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (b'"phase":"confirmed"', b'"phase":"finished"', "phase"),
        (b'"phase":"confirmed",', b"", "phase"),
        (b'"id":"1"', b'"id":1', "id"),
        (b'"text":""', b'"text":null', "text"),
        (b'"2026-11-21T01:02:03.456Z"', b'"yesterday"', "time"),
        (b'"2026-11-21T01:02:03.456Z"', b"1795222923.456", "must be an RFC 3339 time"),
    ],
)
def test_anything_else_is_no_record(old: bytes, new: bytes, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        read(WHOLE.replace(old, new))


def test_a_stored_start_is_the_record_again() -> None:
    again = read_stored(StartRecord, json.loads(START.payload()), starter="pump")

    assert (again.payload(), again.cause, again.samples) == (START.payload(), START.cause, START.samples)
