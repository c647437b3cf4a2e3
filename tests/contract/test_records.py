"""Records are their payloads: each kind by one example, then what JSON cannot say, and the newest ones."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gateway import contract
from gateway.contract import (
    AlarmRecord,
    AuditRecord,
    AvailabilityRecord,
    EventCode,
    EventRecord,
    ForgetRecord,
    FreshRecord,
    GatewayRecord,
    HistoryRecord,
    InfoRecord,
    Latest,
    LineRecord,
    LockRecord,
    Operator,
    OutboxRecord,
    Phase,
    Quality,
    Record,
    ResultRecord,
    Severity,
    StateRecord,
    StatusRecord,
    ValueRecord,
    history_item,
)
from tests.contract.examples import START, TRIP

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

INFO = InfoRecord(
    starter="pump",
    family="ssw07",
    model=None,
    firmware="1.3",
    serial=None,
    line="hall",
    address=1,
    points={"P.002": {"unit": "A", "deadband": 0.5}},
    commands=("start", "stop"),
)

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
        '"points":{"p_002":{"unit":"A","deadband":0.5}},"commands":["start","stop"]}',
    ),
    (
        AuditRecord(
            seq=10,
            time_s=0.0,
            boot="b",
            starter="pump",
            client="alice",
            operator="Al",
            verb="set",
            args={"value": 30.0},
            decision="confirmed",
            code="ok",
            before={"P314": 20},
            after={"P314": 30},
            id="1",
        ),
        "audit",
        '{"seq":10,"time":"1970-01-01T00:00:00.000Z","starter":"pump","client":"alice","verb":"set",'
        '"args":{"value":30.0},"decision":"confirmed","code":"ok","before":{"P314":20},"after":{"P314":30},'
        '"id":"1","operator":"Al","reason":null,"boot":"b"}',
    ),
    (
        START,
        "starter/pump/start",
        '{"id":"b-11","time":"1970-01-01T00:00:00.000Z","boot":"b","seq":11,'
        '"cause":{"source":"command","client":"alice","command_id":"1"},"outcome":"full_voltage",'
        '"acceleration_s":8.1235,"is_baseline":false,"samples":{"t_s":[-1.0,0.5],"current":[null,310.0]}}',
    ),
    (
        TRIP,
        "starter/pump/trip",
        '{"id":"b-12","time":"1970-01-01T00:00:00.000Z","boot":"b","seq":12,"code":"e05","text":"Overload",'
        '"state_before":null,"readings":{"t_s":[-1.0,0.0],"points":{"fault":[false,true]},'
        '"constant":{"current":310.0}},"at_fault":{"P060":{"value":3}},"fault_history":[]}',
    ),
    (
        OutboxRecord(depth=2, oldest_s=1.0, bytes=300, dropped=0, refused=1, reconnects=4),
        "gateway/outbox",
        '{"depth":2,"oldest_s":1.0,"bytes":300,"dropped":0,"refused":1,"reconnects":4}',
    ),
    (
        FreshRecord(token="t", time_s=0.0),
        "gateway/fresh",
        '{"token":"t","time":"1970-01-01T00:00:00.000Z"}',
    ),
    (
        GatewayRecord(
            version="1.0",
            boot="b",
            starters=("pump",),
            lines=("hall",),
            operators=(Operator("alice", ("*",), ("pump",)),),
        ),
        "gateway/info",
        '{"product":"starter-gateway","version":"1.0","contract":1,"boot":"b","mqtt_version":null,'
        '"starters":["pump"],"lines":["hall"],"operators":[{"client":"alice","may":["*"],"starters":["pump"],'
        '"freshness":"token"}],"notice":"not a safety function"}',
    ),
]


@pytest.mark.parametrize(("record", "topic", "payload"), ROWS)
def test_a_record_is_its_payload(record: Record, topic: str, payload: str) -> None:
    assert record.topic == topic
    assert record.payload().decode() == payload


def test_every_kind_that_is_published_has_a_row() -> None:
    published = {
        each
        for each in vars(contract).values()
        if isinstance(each, type) and issubclass(each, Record) and each not in (Record, ForgetRecord)
    }

    assert {type(record) for record, _, _ in ROWS} == published


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


def test_the_newest_records_are_numbered_and_what_is_forgotten_leaves_its_topic() -> None:
    latest = Latest()
    for record in (VALUE, RESULT, STATE, INFO, replace(VALUE, value=13.0)):
        latest.put(record)
    seen = latest.number

    assert latest.find("starter/pump/value/p003") == replace(VALUE, value=13.0)
    assert next(iter(latest.records())) is INFO
    assert [topic for topic, _ in latest.newer_than(seen - 1)] == ["starter/pump/value/p003"]
    latest.put(ForgetRecord(starters=("pump",)))
    assert {record for _, record in latest.newer_than(seen)} == {None}
    assert list(latest.records()) == []
