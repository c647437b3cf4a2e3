"""A reload that fails by a bug; all others are in `tests/scenarios/broker/test_reload.py`."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.app.gateway import App
from tests.rig import RigPlant
from tests.rig.sites import SSW07, starter


async def fail(*_: Any) -> int:
    raise RuntimeError("a bug")


def test_a_bug_is_reported_and_the_next_reload_tries_again(monkeypatch: pytest.MonkeyPatch) -> None:
    with RigPlant(SSW07) as plant:
        plant.run(until=3.0)
        with monkeypatch.context() as patched:
            patched.setattr(App, "change", fail)
            plant.reload(SSW07 + starter("fan", 2, "ssw07"))
            plant.run(until=4.0)
        (bug,), plant.bugs.found = plant.bugs.found, []
        plant.reload(SSW07 + starter("fan", 2, "ssw07"))
        plant.run(until=8.0)

        assert "a bug" in bug
        events = [each.json["code"] for each in plant.messages("gateway/event")]
        assert [code for code in events if code.startswith("reload")] == ["reload_failed", "reloaded"]
        assert plant.last("starter/fan/availability")["state"] == "online"
