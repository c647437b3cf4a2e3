"""What Home Assistant makes of our payloads: the templates rendered in the sandbox that it uses."""

from __future__ import annotations

import json
from typing import Any

import pytest
from jinja2.sandbox import ImmutableSandboxedEnvironment

from gateway.plugins.homeassistant.entities import (
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

SANDBOX = ImmutableSandboxedEnvironment()
RUNNING = GOOD_FLAG.format(name="running")
GOOD, STALE, BAD = ({"quality": quality} for quality in ("good", "stale", "bad"))
STATE = {"state": "running", "running": True, "locked": None}


def rendered(template: str, payload: dict[str, Any]) -> str:
    text = json.dumps(payload)
    return SANDBOX.from_string(template).render(value=text, value_json=json.loads(text))


@pytest.mark.parametrize(
    ("template", "payload", "shown"),
    [
        (GOOD_VALUE, {"value": 12.5, **GOOD}, "12.5"),
        (GOOD_VALUE, {"value": 12.5, **STALE}, "None"),
        (GOOD_VALUE, {"value": 12.5, **BAD}, "None"),
        (GOOD_STATE, {**STATE, **GOOD}, "running"),
        (GOOD_STATE, {**STATE, **STALE}, "None"),
        (GOOD_STATE, {**STATE, **BAD}, "None"),
        (RUNNING, {**STATE, **GOOD}, "True"),
        (RUNNING, {**STATE, **GOOD, "running": False}, "False"),
        (RUNNING, {**STATE, **GOOD, "running": None}, "None"),
        (RUNNING, {**STATE, **STALE}, "None"),
        (GOOD_FLAG.format(name="alarm"), {**STATE, **GOOD}, "None"),  # not every state has it
        (FAULT_NUMBER, {**STATE, **GOOD, "fault_code": 5}, "5"),
        (FAULT_NUMBER, {**STATE, **GOOD, "fault_code": None}, "None"),
        (FAULT_NUMBER, {**STATE, **STALE, "fault_code": 5}, "None"),
        *((GATEWAY_IS_ON, {"state": state}, "online") for state in ("online", "degraded")),
        *((GATEWAY_IS_ON, {"state": state}, "offline") for state in ("starting", "offline")),
        *((STARTER_IS_ON, {"state": state}, "online") for state in ("online", "degraded")),
        *((STARTER_IS_ON, {"state": state}, "offline") for state in ("offline", "disabled")),
        (TROUBLE, {"code": "started", "text": ""}, ""),  # which Home Assistant ignores
        (BUSY, {"utilisation": 0.26551}, "26.6"),
    ],
)
def test_what_is_shown(template: str, payload: dict[str, Any], shown: str) -> None:
    assert rendered(template, payload) == shown


def test_the_attributes_of_a_state_change_with_the_state_only() -> None:
    """What changes every 30 s, such as the time, would fill Home Assistant's database."""

    def attributes(**more: Any) -> Any:
        return json.loads(rendered(STATE_ATTRIBUTES, {**STATE, **GOOD, "reason": "", **more}))

    assert attributes(time="2026") == {"reason": "", "locked_by": None}
    assert attributes(locked={"by": "alice"}) == {"reason": "", "locked_by": "alice"}


def test_a_result_and_a_fault_become_events() -> None:
    text = 'it\'s <done> & "read back"'
    said = {"verb": "start", "code": "ok", "text": text, "id": "1", "duplicate": False}

    result = json.loads(rendered(RESULT, {"phase": "confirmed", **said}))
    fault = json.loads(
        rendered(TROUBLE, {"code": "fault", "text": text, "severity": "error", "time": "2026"})
    )

    assert result == {"event_type": "confirmed", **said}
    assert (fault["event_type"], fault["text"]) == ("fault", text)
