"""What an operator takes for granted is compared with what was just read."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.contract import CommandError
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.starters.policy.preconditions import Expectation

READY = {
    "fault": False,
    "general_enabled": True,
    "power_present": True,
    "running": False,
    "accelerating": False,
    "decelerating": False,
    "full_voltage": False,
    "jog": False,
    "braking": False,
    "reversing": False,
    "fault_code": 0,
}


def refusal(wanted: dict[str, Any], points: dict[str, Any]) -> str:
    try:
        Expectation(load_profile("ssw07"), wanted).check(points)
    except CommandError as error:
        return f"{error.code}: {error.text}"
    return "ok"


@pytest.mark.parametrize(
    ("wanted", "points", "text"),
    [
        ({"state": "running"}, READY, "state is ready, but the command expects running"),
        ({"running": True}, READY, "running is false, but the command expects true"),
        ({"running": True}, {}, "running is unknown, but the command expects true"),
        ({"running": 0}, READY, "running is false, but the command expects 0"),
        ({"fault_code": False}, READY, "fault_code is 0, but the command expects false"),
        ({"state": "ready"}, {}, "state is unknown, but the command expects ready"),
    ],
)
def test_what_is_no_longer_so_is_reported_with_its_reading(
    wanted: dict[str, Any], points: dict[str, Any], text: str
) -> None:
    assert refusal(wanted, points).startswith(f"not_as_expected: {text}")


@pytest.mark.parametrize("wanted", [{"state": "stopped"}, {"state": 1}, {"speed": 3}])
def test_what_the_family_does_not_have_cannot_be_expected(wanted: dict[str, Any]) -> None:
    assert refusal(wanted, READY).startswith("bad_expect")


@pytest.mark.parametrize("family", FAMILIES)
def test_the_state_of_every_family_is_known_from_rows(family: str) -> None:
    assert Expectation(load_profile(family), {"state": "ready"}).codes
