from __future__ import annotations

import json
import math
from typing import Any

import pytest
from gateway.mqtt.contract.payloads import Payloads

from gateway.contract import (
    AlarmRecord,
    AuditRecord,
    AvailabilityRecord,
    EventRecord,
    InfoRecord,
    LineRecord,
    Phase,
    Quality,
    Record,
    ResultRecord,
    Severity,
    StartRecord,
    StateRecord,
    Topics,
    TripRecord,
    ValueRecord,
)
from gateway.families.devices.device import Identity
from gateway.families.profile.load import FAMILIES, LANGUAGES, load_profile
from gateway.families.profile.schema import Variant
from gateway.mqtt.connection.packet_limit import MAX_INCOMING_BYTES
from gateway.mqtt.message import Message
from gateway.starters.setup import StarterSetup
from gateway.starters.telemetry.description import info_of

T = 1_795_222_923.456
AT = '"2026-11-21T01:02:03.456Z"'

VALUE = ValueRecord(
    starter="pump-1", point="current", value=12.0, unit="A", quality=Quality.GOOD, time_s=T, seq=4711
)
RESULT = ResultRecord(
    starter="pump-1",
    client="alice",
    id="c1",
    verb="start",
    phase=Phase.CONFIRMED,
    code="ok",
    text="it runs",
    time_s=T,
)


def payloads() -> Payloads:
    return Payloads(Topics("b"), "boot-1")


def text(message: Message) -> str:
    return message.payload.decode("utf-8")


LATEST = {"qos": 1, "retain": True, "is_queued": False}
STORED = {"qos": 1, "retain": False, "is_queued": True}
STATISTICS = {"qos": 0, "retain": True, "is_queued": False}


@pytest.mark.parametrize(
    ("record", "topic", "delivery", "payload"),
    [
        (
            VALUE,
            "b/starter/pump-1/value/current",
            LATEST,
            f'{{"value":12.0,"unit":"A","quality":"good","time":{AT},"seq":4711,"boot":"boot-1"}}',
        ),
        (
            ValueRecord(
                starter="pump-1",
                point="S1.2.1",
                value=3,
                unit="",
                quality=Quality.STALE,
                time_s=T,
                seq=2,
                label="Remote",
            ),
            "b/starter/pump-1/value/s1_2_1",
            LATEST,
            f'{{"value":3,"unit":"","quality":"stale","time":{AT},"seq":2,"boot":"boot-1","label":"Remote"}}',
        ),
        (
            ValueRecord(
                starter="pump-1",
                point="p003",
                value=math.nan,
                unit="A",
                quality=Quality.BAD,
                time_s=None,
                seq=3,
            ),
            "b/starter/pump-1/value/p003",
            LATEST,
            '{"value":null,"unit":"A","quality":"bad","time":null,"seq":3,"boot":"boot-1"}',
        ),
        (
            StateRecord(
                starter="pump-1",
                state="running",
                quality=Quality.GOOD,
                time_s=T,
                seq=5,
                flags={"running": True, "fault": None, "seq": True},
            ),
            "b/starter/pump-1/state",
            LATEST,
            f'{{"state":"running","quality":"good","time":{AT},"seq":5,"boot":"boot-1","locked":null,"running":true,'
            '"fault":null}',
        ),
        (
            AvailabilityRecord(starter="pump-1", state="offline", since_s=T, reason="silent"),
            "b/starter/pump-1/availability",
            LATEST,
            f'{{"state":"offline","since":{AT},"reason":"silent"}}',
        ),
        (
            AlarmRecord(
                starter="pump-1",
                code="F072",
                is_active=True,
                severity="fault",
                text="Überlast",
                time_s=T,
                cleared_s=None,
                count=3,
                seq=9,
            ),
            "b/starter/pump-1/alarm/f072",
            LATEST,
            f'{{"active":true,"severity":"fault","text":"Überlast","time":{AT},"cleared":null,"count":3,"seq":9,'
            '"boot":"boot-1"}',
        ),
        (
            InfoRecord(
                *(
                    "pump-1",
                    "ssw07",
                    None,
                    "1.3",
                    None,
                    "pumps",
                    1,
                    {"P.002": {"unit": "A", "deadband": 0.5}},
                ),
                commands=("start", "stop"),
            ),
            "b/starter/pump-1/info",
            LATEST,
            '{"family":"ssw07","model":null,"firmware":"1.3","serial":null,"hardware":null,"rated_current_a":null,'
            '"rating":null,"slot":null,"accessories":null,"line":"pumps","address":1,'
            '"points":{"p_002":{"unit":"A","deadband":0.5}},"commands":["start","stop"]}',
        ),
        (
            EventRecord(
                starter="pump-1",
                code="started",
                severity=Severity.INFO,
                text="started",
                time_s=T,
                seq=7,
                data={"peak": 1.0},
            ),
            "b/starter/pump-1/event",
            STORED,
            f'{{"seq":7,"time":{AT},"boot":"boot-1","code":"started","severity":"info","text":"started",'
            '"data":{"peak":1.0}}',
        ),
        (
            EventRecord(
                starter="", code="port_lost", severity=Severity.ERROR, text="unplugged", time_s=T, seq=8
            ),
            "b/gateway/event",
            STORED,
            f'{{"seq":8,"time":{AT},"boot":"boot-1","code":"port_lost","severity":"error","text":"unplugged",'
            '"data":{}}',
        ),
        (
            RESULT,
            "b/result/pump-1/alice",
            STORED,
            f'{{"id":"c1","verb":"start","phase":"confirmed","code":"ok","text":"it runs","time":{AT},'
            '"duplicate":false}',
        ),
        (
            AuditRecord(
                *("pump-1", "alice", "Al", "set", {"value": 30.0}, "confirmed", "ok", T, 10),
                before={"P314": 20},
                after={"P314": 30},
                id="c1",
            ),
            "b/audit",
            STORED,
            f'{{"seq":10,"time":{AT},"starter":"pump-1","client":"alice",'
            '"verb":"set","args":{"value":30.0},"decision":"confirmed","code":"ok","before":{"P314":20},'
            '"after":{"P314":30},"id":"c1","operator":"Al","reason":null,"boot":"boot-1"}',
        ),
        (LineRecord(line="pumps", data={"polls": 3}), "b/gateway/line/pumps", STATISTICS, '{"polls":3}'),
    ],
)
def test_a_record_becomes_the_contracts_message(
    record: Record, topic: str, delivery: dict[str, Any], payload: str
) -> None:
    message = payloads().message(record)

    assert message.topic == topic
    assert {name: getattr(message, name) for name in delivery} == delivery
    assert text(message) == payload


def test_what_a_result_reports_stands_beside_its_own_keys_and_cannot_replace_them() -> None:
    record = ResultRecord(
        *("pump-1", "alice", "c1", "read", Phase.CONFIRMED, "ok", "", T),
        is_duplicate=True,
        values={"parameter": "P003", "value": 81.5, "unit": "A", "label": None, "raw": (815,), "phase": "x"},
        correlation=b"42",
        response_topic="elsewhere",
    )

    message = payloads().message(record)

    assert json.loads(message.payload) == {
        "id": "c1",
        "verb": "read",
        "phase": "confirmed",
        "code": "ok",
        "text": "",
        "time": "2026-11-21T01:02:03.456Z",
        "duplicate": True,
        "parameter": "P003",
        "value": 81.5,
        "unit": "A",
        "label": None,
        "raw": [815],
    }
    assert message.topic == "b/result/pump-1/alice"
    assert message.correlation == b"42"


def test_a_start_and_a_trip_are_queued_once_and_a_trip_goes_last_when_the_outbox_is_full() -> None:
    start = payloads().message(
        StartRecord(starter="pump-1", id="r-7", data={"id": "r-7", "samples": {"t_s": [-1.0, 0.5]}})
    )
    trip = payloads().message(TripRecord(starter="pump-1", id="r-8", data={"id": "r-8", "code": "e05"}))

    assert (start.topic, text(start)) == (
        "b/starter/pump-1/start",
        '{"id":"r-7","samples":{"t_s":[-1.0,0.5]}}',
    )
    assert (trip.topic, text(trip)) == ("b/starter/pump-1/trip", '{"id":"r-8","code":"e05"}')
    for message in (start, trip):
        assert (message.qos, message.retain, message.is_queued) == (1, False, True)
    assert (start.is_droppable, trip.is_droppable) == (True, False)


@pytest.mark.parametrize("family", FAMILIES)
def test_an_info_with_all_names_is_far_below_what_brokers_and_clients_take(family: str) -> None:
    for language in LANGUAGES:
        setup = StarterSetup("p" * 64, "l" * 64, 247, load_profile(family, language), Variant(model="m" * 64))

        info = payloads().message(info_of(setup, setup.variant, Identity()))

        assert info.packet_size < MAX_INCOMING_BYTES / 4
        assert all(
            point["name"] and point["meaning"] for point in json.loads(info.payload)["points"].values()
        )
