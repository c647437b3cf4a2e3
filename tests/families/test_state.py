from __future__ import annotations

from typing import Any

import pytest

from gateway.families.devices import device_of
from gateway.families.profile.load import load_profile
from gateway.families.profile.state import hindrance, state_of
from tests.families.at_rest import SST_AT_REST, WEG_AT_REST

WEG = ("ssw06", "ssw07", "ssw900")


@pytest.mark.parametrize(
    ("family", "changes", "state"),
    [
        *[
            (family, changes, state)
            for family in WEG
            for changes, state in (
                *(
                    ({name: None}, "unknown")
                    for name in ("fault", "running", "accelerating", "general_enabled")
                ),
                ({"fault": True, "running": None}, "fault"),
            )
        ],
        ("ssw900", {"power_present": ...}, "ready"),  # it has no such bit
        ("ssw900", {"s5_1_1_13": True, "running": True}, "running"),
        ("ssw06", {"vb06": None}, "ready"),
        ("ssw07", {"jog": None, "braking": None, "reversing": None}, "ready"),  # old firmware has them not
        ("sst", {"configured": None}, "unknown"),
        ("sst", {"decelerating": None}, "unknown"),
    ],
)
def test_what_decides_and_is_not_known_leaves_the_state_open(
    family: str, changes: dict[str, Any], state: str
) -> None:
    """What the words of each family give: tests/scenarios/values/test_states.py."""
    at_rest = SST_AT_REST if family == "sst" else WEG_AT_REST
    points = {name: value for name, value in {**at_rest, **changes}.items() if value is not ...}

    assert state_of(load_profile(family), points) == state


@pytest.mark.parametrize(
    ("family", "points", "why"),
    [
        ("ssw900", {**WEG_AT_REST, "s5_1_1_13": True}, "the time after a stop is not over"),
        ("ssw07", {**WEG_AT_REST, "general_enabled": False}, "general_enabled is false"),
        ("ssw07", {**WEG_AT_REST, "power_present": None}, "power_present is unknown"),
        ("ssw06", {**WEG_AT_REST, "vb06": 2}, "it is in an adjusting mode (VB06)"),
        ("sst", {**SST_AT_REST, "ready_to_start": False}, "ready_to_start is false"),
        ("sst", SST_AT_REST, ""),
    ],
)
def test_what_keeps_a_motor_from_being_started_is_said_in_words(
    family: str, points: dict[str, Any], why: str
) -> None:
    assert hindrance(load_profile(family), points) == why


@pytest.mark.parametrize(
    ("family", "points", "alarms"),
    [
        ("ssw07", {"fault": True, "fault_code": 28}, ["e28 fault Serial communication inactive"]),
        ("ssw07", {"fault": True, "fault_code": 5}, ["e05 fault Motor overload"]),
        ("ssw07", {"fault": True, "fault_code": 42}, ["e42 fault Fault E42 (not in the manual)"]),
        ("ssw07", {"fault": True, "fault_code": None}, ["fault fault"]),  # just a fault
        ("ssw07", {"fault": True, "fault_code": 0}, ["fault fault"]),
        ("ssw07", {"fault": False, "fault_code": 5}, []),  # the last one, which is over
        ("ssw06", {"fault": True, "alarm": True}, ["fault fault", "alarm alarm"]),
        (
            "ssw900",
            {"fault": True, "fault_code": 1, "alarm": True, "d2_1_1": 128, "d2_1_3": 2, "d2_1_5": 128},
            [
                "f001 fault Motor voltage imbalance",
                "a128 alarm Serial communication timeout",
                "a002 alarm Motor undervoltage",
            ],
        ),
        (
            "ssw900",
            {"fault": True, "fault_code": 999, "alarm": True, "d2_1_2": 998},
            ["f999 fault Fault F999 (not in the manual)", "a998 alarm Alarm A998 (not in the manual)"],
        ),
        ("ssw900", {"fault": True, "fault_code": 0}, ["fault fault"]),
        ("ssw900", {"alarm": True, "d2_1_1": 0}, ["alarm alarm"]),
        (
            "ssw900",
            {"fault": False, "fault_code": 5, "alarm": False, "d2_1_1": 5},
            [],
        ),  # the status denies it
        (
            "sst",
            {"fault": True, "coil12": True, "coil17": True, "coil13": None},
            ["coil12 fault Overcurrent", "coil17 fault Phase loss"],
        ),
        ("sst", {"fault": True}, ["fault fault"]),
        ("sst", {"fault": None}, []),
    ],
)
def test_faults_and_alarms_are_named(family: str, points: dict[str, Any], alarms: list[str]) -> None:
    profile = load_profile(family)

    found = [f"{one.code} {one.severity} {one.text}" for one in device_of(profile).alarms(profile, points)]

    assert len(found) == len(alarms)
    assert all(one.startswith(alarm) for one, alarm in zip(found, alarms, strict=True))
