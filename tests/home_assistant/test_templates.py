"""What Home Assistant makes of our payloads: the templates rendered in the sandbox that it uses."""

from __future__ import annotations

import json
from typing import Any

import pytest

from gateway.home_assistant.entities import (
    BUSY,
    FAULT_NUMBER,
    GATEWAY_IS_ON,
    GOOD_FLAG,
    GOOD_STATE,
    GOOD_VALUE,
    RESULT,
    STARTER_IS_ON,
    STATE_ATTRIBUTES,
    TROUBLE,
)
from gateway.mqtt.contract.payloads import Payloads
from gateway.mqtt.contract.topics import Topics
from gateway.records import (
    EventRecord,
    LockRecord,
    Phase,
    Quality,
    Record,
    ResultRecord,
    Severity,
    StateRecord,
    ValueRecord,
)
from tests.home_assistant.announced import Rendering

T = 1_760_000_000.0
PAYLOADS = Payloads(Topics("b"), "run-1")
RENDERING = Rendering()


def payload(record: Record) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(PAYLOADS.message(record).payload)
    return found


def state(quality: Quality, *, running: bool | None = True, lock: LockRecord | None = None) -> StateRecord:
    return StateRecord("p", "running", quality, T, 1, {"running": running}, lock)


@pytest.mark.parametrize(
    ("quality", "shown"), [(Quality.GOOD, "12.5"), (Quality.STALE, "None"), (Quality.BAD, "None")]
)
def test_a_value_is_shown_only_while_it_is_good(quality: Quality, shown: str) -> None:
    record = ValueRecord("p", "current", 12.5, "A", quality, T, 1)

    assert RENDERING.value(GOOD_VALUE, payload(record)) == shown


@pytest.mark.parametrize("quality", list(Quality))
def test_a_state_is_shown_only_while_it_is_good(quality: Quality) -> None:
    shown = RENDERING.value(GOOD_STATE, payload(state(quality)))

    assert shown == ("running" if quality is Quality.GOOD else "None")


@pytest.mark.parametrize(
    ("quality", "running", "shown"),
    [
        (Quality.GOOD, True, "True"),
        (Quality.GOOD, False, "False"),
        (Quality.GOOD, None, "None"),
        (Quality.STALE, True, "None"),
    ],
)
def test_a_flag_is_on_off_or_unknown(quality: Quality, running: bool | None, shown: str) -> None:
    template = GOOD_FLAG.format(name="running")

    assert RENDERING.value(template, payload(state(quality, running=running))) == shown


def test_the_code_of_a_fault_is_shown_only_while_the_state_carries_it() -> None:
    def shown(fault_code: int | None, quality: Quality = Quality.GOOD) -> str:
        record = StateRecord("p", "fault", quality, T, 1, {"fault": True}, fault_code=fault_code)
        return RENDERING.value(FAULT_NUMBER, payload(record))

    assert (shown(5), shown(None), shown(5, Quality.STALE)) == ("5", "None", "None")


def test_a_flag_that_the_state_does_not_have_is_unknown() -> None:
    assert RENDERING.value(GOOD_FLAG.format(name="alarm"), payload(state(Quality.GOOD))) == "None"


def test_the_attributes_of_a_state_change_with_the_state_only() -> None:
    """What changes every 30 s, such as the time, would fill Home Assistant's database."""
    lock = LockRecord("alice", T, "bearing")

    def attributes(record: StateRecord) -> Any:
        return json.loads(RENDERING.value(STATE_ATTRIBUTES, payload(record)))

    assert attributes(state(Quality.GOOD)) == {"reason": "", "locked_by": None}
    assert attributes(state(Quality.GOOD, lock=lock)) == {"reason": "", "locked_by": "alice"}


@pytest.mark.parametrize(
    ("gateway", "shown"),
    [("online", "online"), ("degraded", "online"), ("starting", "offline"), ("offline", "offline")],
)
def test_the_gateway_is_available_while_it_is_online_or_degraded(gateway: str, shown: str) -> None:
    status = json.loads(PAYLOADS.status(gateway, time_s=T, since_s=T, reason=None).payload)

    assert RENDERING.value(GATEWAY_IS_ON, status) == shown


@pytest.mark.parametrize(
    ("starter", "shown"),
    [("online", "online"), ("degraded", "online"), ("offline", "offline"), ("disabled", "offline")],
)
def test_a_starter_is_available_while_it_answers(starter: str, shown: str) -> None:
    assert RENDERING.value(STARTER_IS_ON, {"state": starter}) == shown


@pytest.mark.parametrize("phase", list(Phase))
def test_a_result_becomes_an_event_of_its_phase(phase: Phase) -> None:
    record = ResultRecord("p", "ha", "1", "start", phase, "ok", 'it\'s <done> & "read back"', T)

    event = json.loads(RENDERING.value(RESULT, payload(record)))

    assert event == {
        "event_type": phase,
        "verb": "start",
        "code": "ok",
        "text": 'it\'s <done> & "read back"',
        "id": "1",
        "duplicate": False,
    }


def test_a_fault_becomes_an_event_with_its_text_and_other_events_none() -> None:
    def rendered(code: str) -> str:
        record = EventRecord("p", code, Severity.ERROR, "fault E05 Motor overload", T, 1)
        return RENDERING.value(TROUBLE, payload(record))

    event = json.loads(rendered("fault"))
    assert (event["event_type"], event["text"]) == ("fault", "fault E05 Motor overload")
    assert rendered("started") == ""  # which Home Assistant ignores


def test_the_load_of_a_line_is_shown_in_percent() -> None:
    assert RENDERING.value(BUSY, {"utilisation": 0.26551}) == "26.6"
