"""What the catalogue of metrics promises; `tests/scenarios/plugins/test_metrics.py` shows the metrics."""

from __future__ import annotations

import pytest

from gateway.families.profile.load import FAMILIES, load_profile
from gateway.plugins.metrics.catalogue import MOTOR_POINTS
from gateway.starters.state import unit_of


@pytest.mark.parametrize("family", FAMILIES)
def test_the_unit_of_every_familys_point_can_be_converted(family: str) -> None:
    profile = load_profile(family)
    points = [name for name in MOTOR_POINTS if name in profile.points]

    assert [name for name in points if unit_of(profile, name) not in MOTOR_POINTS[name].factors] == []
