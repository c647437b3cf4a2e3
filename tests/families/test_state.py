from __future__ import annotations

from typing import Any

import pytest

from gateway.families.devices import device_of
from gateway.families.profile.load import load_profile
from gateway.families.profile.state import STATES, hindrance, state_of
from tests.families.at_rest import SST_AT_REST, WEG_AT_REST

WEG = ("ssw06", "ssw07", "ssw900")


@pytest.mark.parametrize("family", WEG)
@pytest.mark.parametrize(
    ("changes", "state"),
    [
        ({}, "ready"),
        ({"general_enabled": False}, "not_ready"),
        ({"running": True}, "running"),
        ({"running": True, "accelerating": True}, "starting"),
        ({"running": True, "decelerating": True}, "stopping"),
        ({"jog": True}, "running"),
        ({"braking": True}, "running"),
        ({"reversing": True}, "running"),
        ({"running": True, "fault": True}, "fault"),
        ({"fault": None}, "unknown"),
        ({"running": None}, "unknown"),
        ({"accelerating": None}, "unknown"),
        ({"general_enabled": None}, "unknown"),
        ({"fault": True, "running": None}, "fault"),
    ],
)
def test_the_status_word_decides_the_state_of_a_weg_starter(
    family: str, changes: dict[str, Any], state: str
) -> None:
    assert state_of(load_profile(family), {**WEG_AT_REST, **changes}) == state
    assert state in STATES


@pytest.mark.parametrize(
    ("family", "changes", "state"),
    [
        # an accepted start is one, although the motor does not accelerate yet
        *[("ssw900", {bit: True}, "starting") for bit in load_profile("ssw900").state.starting],
        ("ssw900", {"power_present": ...}, "ready"),  # it has no such bit
        ("ssw900", {"s5_1_1_13": True}, "not_ready"),  # the time after a stop
        ("ssw900", {"s5_1_1_13": False}, "ready"),
        ("ssw900", {"s5_1_1_13": True, "running": True}, "running"),
        # it says that it does not run as soon as the stop is received (S6-20)
        ("ssw06", {"decelerating": True}, "stopping"),
        ("ssw06", {"power_present": False}, "not_ready"),
        ("ssw07", {"power_present": False}, "not_ready"),
        *[
            ("ssw06", {"vb06": mode}, state)
            for mode, state in ((1, "not_ready"), (2, "not_ready"), (0, "ready"), (None, "ready"))
        ],
        # bits that old firmware does not have
        ("ssw07", {"jog": None, "braking": None, "reversing": None}, "ready"),
    ],
)
def test_a_family_has_states_of_its_own(family: str, changes: dict[str, Any], state: str) -> None:
    points = {name: value for name, value in {**WEG_AT_REST, **changes}.items() if value is not ...}

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
    ("changes", "state"),
    [
        ({}, "ready"),
        ({"configured": False}, "not_ready"),
        ({"ready_to_start": False}, "not_ready"),
        ({"configured": None}, "unknown"),
        ({"accelerating": True, "running": True}, "starting"),
        ({"full_voltage": True, "running": True}, "running"),
        ({"decelerating": True}, "stopping"),
        ({"decelerating": None}, "unknown"),
        ({"fault": True, "full_voltage": True}, "fault"),
    ],
)
def test_register_19_and_three_coils_decide_the_state_of_an_sst(changes: dict[str, Any], state: str) -> None:
    assert state_of(load_profile("sst"), {**SST_AT_REST, **changes}) == state


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
