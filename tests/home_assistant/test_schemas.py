"""Home Assistant's own schemas and templates judge what is announced: 2024.3.3, the last for Python 3.11.

Its device-based discovery came later, so the root is judged by our own list; each component is judged here.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from gateway.plugins.homeassistant.entities import COMMAND, GOOD_FLAG, GOOD_STATE, GOOD_VALUE, RESULT, TROUBLE
from tests.home_assistant.announced import announced

JUDGE = Path(__file__).with_name("judge.py")
PYTHON = Path(__file__).parents[2] / "build" / "home-assistant" / "bin" / "python"  # by get-home-assistant.sh
STALE = '{"value":12.5,"state":"running","running":true,"quality":"stale"}'
GOOD = STALE.replace("stale", "good")
PHASE = '{"phase":"confirmed","verb":"stop","code":"ok","text":"a <b>","id":null,"duplicate":false}'


@pytest.fixture(scope="module", autouse=True)
def _installed() -> None:
    if not PYTHON.exists():
        is_due = os.environ.get("CI") == "true" and sys.version_info[:2] == (3, 11)
        assert not is_due, "tests/home_assistant/get-home-assistant.sh could not install it"
        pytest.skip("Home Assistant 2024.3.3 is not here (Python 3.11 and a network are needed)")


def ask(components: list[dict[str, Any]], renders: list[dict[str, str]]) -> Any:
    """Return what Home Assistant makes of components and templates."""
    asked = json.dumps({"components": components, "renders": renders})
    done = subprocess.run(
        [PYTHON, "-I", JUDGE], input=asked, capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


def test_every_component_is_as_its_platforms_schema_demands() -> None:
    found = announced().values()
    whole = [
        {**each, "device": device["device"]} for device in found for each in device["components"].values()
    ]

    assert ask(whole, [])["mistakes"] == []
    assert {each["platform"] for each in whole} == {"sensor", "binary_sensor", "button", "event"}


def test_the_judge_sees_what_is_wrong() -> None:
    good = announced()["fan"]["components"]
    wrong = [
        {**good["current"], "device_class": "amperes"},
        {**good["stop"], "command_topic": "a/#"},
        {**good["result"], "surprise": 1},
        {**good["running"], "value_template": "{{ value_json."},
    ]

    assert len(ask(wrong, [])["mistakes"]) == len(wrong)


def test_the_templates_are_rendered_as_our_own_tests_render_them() -> None:
    renders = [
        {"template": GOOD_VALUE, "payload": GOOD},
        {"template": GOOD_VALUE, "payload": STALE},
        {"template": GOOD_STATE, "payload": GOOD},
        {"template": GOOD_STATE, "payload": STALE},
        {"template": GOOD_FLAG.format(name="running"), "payload": GOOD},
        {"template": GOOD_FLAG.format(name="running"), "payload": STALE},
        {"template": GOOD_FLAG.format(name="alarm"), "payload": GOOD},
        {"template": TROUBLE, "payload": '{"code":"started"}'},
        {"template": RESULT, "payload": PHASE},
        {"template": COMMAND},
    ]

    *shown, result, command = ask([], renders)["rendered"]

    assert shown == ["12.5", "None", "running", "None", "True", "None", "None", ""]
    assert json.loads(result)["event_type"] == "confirmed"
    assert set(json.loads(command)) == {"id", "issued_at", "ttl_s", "operator"}
