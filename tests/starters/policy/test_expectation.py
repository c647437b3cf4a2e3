"""What an operator takes for granted is compared with what was just read."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.contract import CommandError
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.starters.policy.preconditions import Expectation

AT_REST = dict.fromkeys(("running", "accelerating", "decelerating", "jog", "braking", "reversing"), False)
READY = {"fault": False, "general_enabled": True, "power_present": True, "full_voltage": False, **AT_REST}


@pytest.mark.parametrize(
    ("wanted", "points", "text"),
    [
        ({"state": "running"}, READY, "state is ready, but the command expects running"),
        ({"running": True}, {}, "running is unknown, but the command expects true"),
        ({"running": 0}, READY, "running is false, but the command expects 0"),
        ({"fault_code": False}, {"fault_code": 0}, "fault_code is 0, but the command expects false"),
        ({"state": "ready"}, {}, "state is unknown, but the command expects ready"),
        ({"state": "stopped"}, READY, "bad_expect"),
        ({"state": 1}, READY, "bad_expect"),
    ],
)
def test_what_is_no_longer_so_is_reported_with_its_reading(
    wanted: dict[str, Any], points: dict[str, Any], text: str
) -> None:
    with pytest.raises(CommandError, match=text):
        Expectation(load_profile("ssw07"), wanted).check(points)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_state_of_every_family_is_known_from_rows(family: str) -> None:
    assert Expectation(load_profile(family), {"state": "ready"}).codes
