from __future__ import annotations

from typing import Any

import pytest

from gateway.families.devices import device_of
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.state import STATES, hindrance, state_of
from tests.families.at_rest import SST_AT_REST, WEG_AT_REST

STARTING = load_profile("ssw900").state.starting

WEG = ("ssw06", "ssw07", "ssw900")


@pytest.mark.parametrize("family", FAMILIES)
def test_a_starter_of_which_nothing_is_known_is_in_an_unknown_state(family: str) -> None:
    assert state_of(load_profile(family), {}) == "unknown"


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


@pytest.mark.parametrize("bit", STARTING)
def test_an_ssw900_is_starting_from_the_accepted_start_on_although_it_does_not_accelerate_yet(
    bit: str,
) -> None:
    assert state_of(load_profile("ssw900"), {**WEG_AT_REST, bit: True}) == "starting"


def test_an_ssw06_is_stopping_as_long_as_it_decelerates_although_it_says_that_it_does_not_run() -> None:
    points = {**WEG_AT_REST, "running": False, "decelerating": True}

    assert state_of(load_profile("ssw06"), points) == "stopping"


@pytest.mark.parametrize("family", ["ssw06", "ssw07"])
def test_a_starter_without_supply_is_not_ready(family: str) -> None:
    assert state_of(load_profile(family), {**WEG_AT_REST, "power_present": False}) == "not_ready"


def test_an_ssw900_needs_no_supply_bit_because_it_has_none() -> None:
    points = {name: value for name, value in WEG_AT_REST.items() if name != "power_present"}

    assert state_of(load_profile("ssw900"), points) == "ready"


@pytest.mark.parametrize(
    ("mode", "state"), [(1, "not_ready"), (2, "not_ready"), (0, "ready"), (None, "ready")]
)
def test_an_ssw06_in_an_adjusting_mode_is_not_ready(mode: int | None, state: str) -> None:
    assert state_of(load_profile("ssw06"), {**WEG_AT_REST, "vb06": mode}) == state


def test_an_ssw900_is_not_ready_while_the_time_after_a_stop_runs() -> None:
    profile = load_profile("ssw900")

    assert state_of(profile, {**WEG_AT_REST, "s5_1_1_13": True}) == "not_ready"
    assert state_of(profile, {**WEG_AT_REST, "s5_1_1_13": False}) == "ready"
    assert state_of(profile, {**WEG_AT_REST, "s5_1_1_13": True, "running": True}) == "running"


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


def test_bits_that_an_old_ssw07_does_not_have_leave_its_state_known() -> None:
    points = {**WEG_AT_REST, "jog": None, "braking": None, "reversing": None}

    assert state_of(load_profile("ssw07"), points) == "ready"


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


def codes(family: str, points: dict[str, Any]) -> list[tuple[str, str, str]]:
    profile = load_profile(family)
    return [(one.code, one.severity, one.text) for one in device_of(profile).alarms(profile, points)]


def test_an_ssw07_names_its_fault_by_the_number_it_gives() -> None:
    assert codes("ssw07", {"fault": True, "fault_code": 28}) == [
        ("e28", "fault", "Serial communication inactive")
    ]
    assert codes("ssw07", {"fault": True, "fault_code": 5}) == [("e05", "fault", "Motor overload")]
    assert codes("ssw07", {"fault": True, "fault_code": 42}) == [
        ("e42", "fault", "Fault E42 (not in the manual)")
    ]


@pytest.mark.parametrize("number", [None, 0])
def test_a_fault_without_a_number_is_just_a_fault(number: int | None) -> None:
    points = {"fault": True, "fault_code": number}

    assert [code for code, _, _ in codes("ssw07", points)] == ["fault"]
    assert [code for code, _, _ in codes("ssw900", points)] == ["fault"]


def test_the_last_fault_of_an_ssw07_that_is_over_is_no_alarm() -> None:
    assert codes("ssw07", {"fault": False, "fault_code": 5}) == []


def test_the_alarm_bit_of_an_ssw06_is_an_alarm() -> None:
    assert [(code, severity) for code, severity, _ in codes("ssw06", {"fault": True, "alarm": True})] == [
        ("fault", "fault"),
        ("alarm", "alarm"),
    ]


def test_an_ssw900_names_its_fault_and_up_to_five_alarms() -> None:
    points = {"fault": True, "fault_code": 1, "alarm": True, "d2_1_1": 128, "d2_1_3": 2, "d2_1_5": 128}

    assert codes("ssw900", points) == [
        ("f001", "fault", "Motor voltage imbalance"),
        ("a128", "alarm", alarm_text("a128")),
        ("a002", "alarm", "Motor undervoltage"),
    ]


def alarm_text(code: str) -> str:
    return next(alarm.text for alarm in load_profile("ssw900").alarms if alarm.code == code)


def test_an_ssw900_fault_that_no_table_names_is_shown_by_its_number() -> None:
    assert codes("ssw900", {"fault": True, "fault_code": 999, "alarm": True, "d2_1_2": 998}) == [
        ("f999", "fault", "Fault F999 (not in the manual)"),
        ("a998", "alarm", "Alarm A998 (not in the manual)"),
    ]


def test_an_ssw900_alarm_without_a_number_is_just_an_alarm() -> None:
    assert [code for code, _, _ in codes("ssw900", {"alarm": True, "d2_1_1": 0})] == ["alarm"]


def test_numbers_of_an_ssw900_count_no_more_once_its_status_denies_them() -> None:
    assert codes("ssw900", {"fault": False, "fault_code": 5, "alarm": False, "d2_1_1": 5}) == []


def test_each_error_coil_of_an_sst_is_a_fault_of_its_own() -> None:
    assert codes("sst", {"fault": True, "coil12": True, "coil17": True, "coil13": None}) == [
        ("coil12", "fault", "Overcurrent"),
        ("coil17", "fault", "Phase loss"),
    ]


def test_coil_9_of_an_sst_alone_is_just_a_fault() -> None:
    assert [code for code, _, _ in codes("sst", {"fault": True})] == ["fault"]
    assert codes("sst", {"fault": None}) == []
