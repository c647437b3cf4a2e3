"""Records are their payloads: each kind by one example, then what JSON cannot say, and the newest ones."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gateway.contract import (
    AlarmRecord,
    AuditRecord,
    AvailabilityRecord,
    EventCode,
    EventRecord,
    ForgetRecord,
    FreshRecord,
    HistoryRecord,
    InfoRecord,
    Latest,
    LineRecord,
    LockRecord,
    OutboxRecord,
    Phase,
    Quality,
    Record,
    ResultRecord,
    Severity,
    StartRecord,
    StateRecord,
    StatusRecord,
    Topics,
    TripRecord,
    ValueRecord,
    history_item,
    read_record,
)
from gateway.mqtt.message import message_of

VALUE = ValueRecord(
    starter="pump", point="P003", value=12.0, unit="A", quality=Quality.GOOD, time_s=1.5, seq=7, boot="b"
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

TRIP = TripRecord(starter="pump", id="r-8", data={"code": "e05"})

ROWS = [
    (
        VALUE,
        "starter/pump/value/p003",
        '{"value":12.0,"unit":"A","quality":"good","time":"1970-01-01T00:00:01.500Z","seq":7,"boot":"b"}',
    ),
    (
        replace(VALUE, value=2, label="local", reason="why"),
        "starter/pump/value/p003",
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
        AvailabilityRecord(starter="pump", state="offline", since_s=0.0, reason="no reply"),
        "starter/pump/availability",
        '{"state":"offline","since":"1970-01-01T00:00:00.000Z","reason":"no reply"}',
    ),
    (
        AlarmRecord(
            starter="pump",
            code="E05",
            is_active=True,
            severity="fault",
            text="overload",
            time_s=0.0,
            cleared_s=None,
            count=1,
            seq=2,
            boot="b",
        ),
        "starter/pump/alarm/e05",
        '{"active":true,"severity":"fault","text":"overload","time":"1970-01-01T00:00:00.000Z",'
        '"cleared":null,"count":1,"seq":2,"boot":"b"}',
    ),
    (
        EventRecord(
            starter="",
            seq=3,
            time_s=0.0,
            boot="b",
            code=EventCode.CLOCK_TRUSTED,
            severity=Severity.INFO,
            text="steady",
        ),
        "gateway/event",
        '{"seq":3,"time":"1970-01-01T00:00:00.000Z","boot":"b","code":"clock_trusted","severity":"info",'
        '"text":"steady","data":{}}',
    ),
    (
        RESULT,
        "result/pump/alice",
        '{"id":"1","verb":"read","phase":"confirmed","code":"ok","text":"read",'
        '"time":"1970-01-01T00:00:00.000Z","duplicate":false,"value":3.0}',
    ),
    (
        StatusRecord(state="offline", time_s=None, boot="b-2", since_s=None, reason="lost", run="b"),
        "gateway/status",
        '{"state":"offline","time":null,"boot":"b-2","since":null,"reason":"lost","run":"b"}',
    ),
    (
        AuditRecord(
            seq=4,
            time_s=0.0,
            starter="pump",
            client="alice",
            verb="set",
            args={"value": 3.0},
            decision="confirmed",
            code="ok",
            operator=None,
            source="web",
            boot="b",
        ),
        "audit",
        '{"seq":4,"time":"1970-01-01T00:00:00.000Z","starter":"pump","client":"alice","verb":"set",'
        '"args":{"value":3.0},"decision":"confirmed","code":"ok","before":{},"after":{},"id":null,'
        '"source":"web","operator":null,"reason":null,"boot":"b"}',
    ),
    (
        OutboxRecord(depth=1, oldest_s=0.0, bytes=9, dropped=0, refused=0, reconnects=2),
        "gateway/outbox",
        '{"depth":1,"oldest_s":0.0,"bytes":9,"dropped":0,"refused":0,"reconnects":2}',
    ),
    (FreshRecord(token="t", time_s=0.0), "gateway/fresh", '{"token":"t","time":"1970-01-01T00:00:00.000Z"}'),
    (StartRecord(starter="pump", id="r-7", data={"t_s": [-1.0]}), "starter/pump/start", '{"t_s":[-1.0]}'),
    (TRIP, "starter/pump/trip", '{"code":"e05"}'),
    (LineRecord(line="hall", data={"polls": 1, "load": 0.5}), "gateway/line/hall", '{"polls":1,"load":0.5}'),
    (
        HistoryRecord(starter="pump", boot="b", items=[history_item(VALUE)]),
        "starter/pump/history",
        '{"boot":"b","items":[{"point":"p003","value":12.0,"quality":"good",'
        '"time":"1970-01-01T00:00:01.500Z","seq":7}]}',
    ),
]


@pytest.mark.parametrize(("record", "topic", "payload"), ROWS)
def test_a_record_is_its_payload(record: Record, topic: str, payload: str) -> None:
    assert record.topic == topic
    assert record.payload().decode() == payload


@pytest.mark.parametrize(
    ("value", "text"),
    [(float("nan"), "null"), (float("inf"), "null"), (1e16, "1.0e+16"), (1e-7, "1.0e-7"), (True, "true")],
)
def test_a_number_has_a_decimal_part_and_is_never_nan(value: float, text: str) -> None:
    assert replace(VALUE, value=value).payload().startswith(b'{"value":%b,' % text.encode())


def test_half_a_character_becomes_a_question_mark() -> None:
    assert b'"unit":"?"' in replace(VALUE, unit="\ud800").payload()


def test_only_the_one_final_result_of_a_command_has_a_name() -> None:
    assert RESULT.key == "alice/1"
    assert replace(RESULT, is_duplicate=True).key == ""
    assert replace(RESULT, phase=Phase.WRITTEN).key == ""


def test_a_payload_is_read_back_as_its_record() -> None:
    names = {"starter": "pump", "point": "P003"}

    assert read_record(ValueRecord, VALUE.payload(), **names) == VALUE
    assert Topics("a/b").of(ValueRecord, **names) == f"a/b/{VALUE.topic}"


@pytest.mark.parametrize(
    ("record", "how"),
    [(VALUE, (1, True, False, False)), (RESULT, (1, False, True, False)), (TRIP, (1, False, True, False))],
)
def test_a_message_is_retained_or_queued_and_results_and_trips_are_dropped_last(
    record: Record, how: tuple[int, bool, bool, bool]
) -> None:
    message = message_of(record, "a/b")

    assert (message.qos, message.retain, message.is_queued, message.is_droppable) == how
    assert (message.topic, message.key) == (f"a/b/{record.topic}", record.key)
    assert message.correlation == getattr(record, "correlation", None)


def test_the_newest_records_are_numbered_and_what_is_forgotten_leaves_its_topic() -> None:
    latest = Latest()
    info = InfoRecord(
        starter="pump",
        family="ssw07",
        model=None,
        firmware=None,
        serial=None,
        line="hall",
        address=1,
        points={},
        commands=(),
    )
    for record in (VALUE, RESULT, STATE, info, replace(VALUE, value=13.0)):
        latest.put(record)
    seen = latest.number

    assert latest.find("starter/pump/value/p003") == replace(VALUE, value=13.0)
    assert next(iter(latest.records())) is info
    assert [topic for topic, _ in latest.newer_than(seen - 1)] == ["starter/pump/value/p003"]
    latest.put(ForgetRecord(starters=("pump",)))
    assert {record for _, record in latest.newer_than(seen)} == {None}
    assert list(latest.records()) == []
