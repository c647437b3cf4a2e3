"""A plugin whose package is not installed: one event, and everything else goes on."""

from __future__ import annotations

import sys

import pytest

from tests.rig import RigPlant
from tests.rig.sites import METRICS, SPARKPLUG, SSW07, WEB


@pytest.mark.parametrize(
    ("package", "late", "given", "event"),
    [
        ("starlette", "gateway.plugins.web.", WEB, "web_away"),
        ("prometheus_client", "gateway.plugins.metrics.collector", WEB + METRICS, "metrics_away"),
        ("google.protobuf", "gateway.plugins.sparkplug.", SPARKPLUG, "sparkplug_away"),
    ],
)
def test_what_is_not_installed_is_said_once_and_everything_else_goes_on(
    package: str, late: str, given: str, event: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [each for each in sys.modules if each.startswith((package, late))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)

    with RigPlant(SSW07 + given) as plant:
        plant.run(until=60.0)

        said = [each.json for each in plant.messages("gateway/event") if each.json["code"] == event]
        assert ["not installed" in each["text"] for each in said] == [True]
        assert plant.last("starter/pump/availability")["state"] == "online"
