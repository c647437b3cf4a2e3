"""The state of a starter, its alarms, and what a command demands of it: which reading breaks which rule."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.families.command.interlock import check
from gateway.families.devices import device_of
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.families.profile.state import hindrance, state_of

WEG = ("ssw06", "ssw07", "ssw900")
WEG_AT_REST: dict[str, Any] = {
    **dict.fromkeys(
        ("running", "jog", "accelerating", "decelerating", "braking", "reversing", "fault"), False
    ),
    **dict.fromkeys(load_profile("ssw900").state.starting, False),
    "general_enabled": True,
    "power_present": True,
}


SST_AT_REST: dict[str, Any] = {
    **dict.fromkeys(("fault", "running", "accelerating", "full_voltage", "decelerating"), False),
    "configured": True,
    "ready_to_start": True,
}


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


FREE_WEG = {**WEG_AT_REST, "remote": True, "current_limit": False, "full_voltage": False}
FREE_SST = {**SST_AT_REST, "coil7": False, "coil8": False}
AT_REST = {"ssw06": FREE_WEG, "ssw07": FREE_WEG, "ssw900": FREE_WEG, "sst": FREE_SST}


def codes(family: str, rule: str, points: dict[str, Any]) -> list[str]:
    return [violation.code for violation in check(load_profile(family), (rule,), points)]


@pytest.mark.parametrize(
    ("family", "rule", "bad", "code"),
    [
        ("ssw06", "remote", {"remote": None}, "state_unknown"),
        ("ssw06", "is_ready", {"power_present": False}, "not_ready"),
        ("ssw06", "is_ready", {"running": True}, "motor_running"),
        ("ssw06", "is_ready", {"fault": True}, "fault_active"),
        ("ssw06", "is_ready", {"general_enabled": None}, "state_unknown"),
        ("ssw06", "is_stopped", {"braking": True}, "motor_running"),
        ("ssw06", "is_stopped", {"running": None}, "state_unknown"),
        ("sst", "serial_controls", {"coil7": True}, None),
        ("sst", "serial_controls", {"coil8": None}, None),
        ("sst", "is_stopped", {"full_voltage": True}, "motor_running"),
    ],
)
def test_a_reading_breaks_a_rule_with_a_code_that_says_what_is_wrong(
    family: str, rule: str, bad: dict[str, Any], code: str | None
) -> None:
    assert codes(family, rule, AT_REST[family]) == []

    (violation,) = check(load_profile(family), (rule,), {**AT_REST[family], **bad})

    assert code in (None, violation.code)
    assert "required" not in violation.text  # never what would have been right


@pytest.mark.parametrize(
    ("family", "rule"),
    [
        *[("ssw07", rule) for rule in ("remote", "general_enabled", "no_fault", "has_fault")],
        *[("ssw07", rule) for rule in ("is_ready", "is_stopped")],
        *[("sst", rule) for rule in ("serial_controls", "configured", "is_ready", "is_stopped")],
    ],
)
def test_an_unknown_reading_breaks_a_rule(family: str, rule: str) -> None:
    assert len(codes(family, rule, {})) == 1


@pytest.mark.parametrize(
    ("family", "slot", "row", "is_obeyed"),
    [
        *[(family, None, {"P229": (n,)}, n == 2) for family in ("ssw06", "ssw07") for n in range(5)],
        *[("ssw900", slot, {"C3.2": (n,)}, n == 3 + slot) for slot in (1, 2) for n in range(6)],
        ("ssw900", None, {"C3.2": (4,)}, False),  # the slot is not known
        ("ssw07", None, {}, False),
        ("sst", None, {"P229": (2,)}, False),
    ],
)
def test_a_starter_in_local_mode_is_commanded_only_where_its_own_setting_says_so(
    family: str, slot: Any, row: dict[str, Any], is_obeyed: bool
) -> None:
    points = {**AT_REST[family], "remote": False, **row}

    assert (not check(load_profile(family), ("remote",), points, variant=Variant(slot=slot))) is is_obeyed
    assert check(load_profile(family), ("remote",), {**points, "remote": None})  # it is not known where it is


def test_a_bit_that_an_old_ssw07_does_not_have_does_not_keep_it_from_being_stopped() -> None:
    assert codes("ssw07", "is_stopped", {**FREE_WEG, "jog": None, "braking": None, "reversing": None}) == []
