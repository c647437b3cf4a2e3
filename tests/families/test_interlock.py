from __future__ import annotations

from typing import Any

import pytest

from gateway.families.command.interlock import RULES, check, points_needed
from gateway.families.profile.load import FAMILIES, load_profile
from tests.families.at_rest import SST_AT_REST, WEG_AT_REST


def broken(family: str, rules: tuple[str, ...], points: dict[str, Any]) -> list[str]:
    return [rule for rule in rules if check(load_profile(family), (rule,), points)]


@pytest.mark.parametrize("family", FAMILIES)
def test_every_rule_that_a_profile_demands_exists(family: str) -> None:
    commands = load_profile(family).commands.values()

    assert {rule for command in commands for rule in command.requires} <= set(RULES)


@pytest.mark.parametrize(
    ("family", "rule"),
    [
        *[
            ("ssw07", rule)
            for rule in ("remote", "general_enabled", "no_fault", "has_fault", "is_ready", "is_stopped")
        ],
        *[("sst", rule) for rule in ("serial_controls", "configured", "is_ready", "is_stopped")],
    ],
)
def test_an_unknown_reading_breaks_a_rule(family: str, rule: str) -> None:
    assert broken(family, (rule,), {}) == [rule]


@pytest.mark.parametrize(
    ("rule", "good", "bad"),
    [
        ("remote", {"remote": True}, {"remote": False}),
        ("general_enabled", {"general_enabled": True}, {"general_enabled": False}),
        ("no_fault", {"fault": False}, {"fault": True}),
        ("has_fault", {"fault": True}, {"fault": False}),
        ("power_present", {"power_present": True}, {"power_present": False}),
        ("is_ready", WEG_AT_REST, {**WEG_AT_REST, "running": True}),
        ("is_stopped", WEG_AT_REST, {**WEG_AT_REST, "braking": True}),
    ],
)
def test_a_rule_holds_on_what_it_demands_and_on_nothing_else(
    rule: str, good: dict[str, Any], bad: dict[str, Any]
) -> None:
    at_rest = {"current_limit": False, "full_voltage": False}

    assert broken("ssw06", (rule,), {**at_rest, **good}) == []
    assert broken("ssw06", (rule,), {**at_rest, **bad}) == [rule]


@pytest.mark.parametrize(
    ("rule", "bad"),
    [
        ("serial_controls", {"coil7": True}),
        ("serial_controls", {"coil8": True}),
        ("serial_controls", {"coil8": None}),
        ("configured", {"configured": False}),
        ("is_ready", {"ready_to_start": False}),
        ("is_stopped", {"full_voltage": True}),
    ],
)
def test_the_rules_of_the_sst_are_decoded_from_its_coils_and_register_19(
    rule: str, bad: dict[str, Any]
) -> None:
    good = {**SST_AT_REST, "coil7": False, "coil8": False}

    assert broken("sst", (rule,), good) == []
    assert broken("sst", (rule,), {**good, **bad}) == [rule]


@pytest.mark.parametrize(
    ("change", "reading"),
    [
        ({"s5_1_1_13": True}, "the state is not_ready: the time after a stop is not over"),
        ({"general_enabled": None}, "the state is unknown: general_enabled is unknown"),
        ({"fault": None}, "the state is unknown"),
        ({"running": True}, "the state is running"),
    ],
)
def test_why_a_starter_is_not_ready_is_reported(change: dict[str, Any], reading: str) -> None:
    (violation,) = check(load_profile("ssw900"), ["is_ready"], {**WEG_AT_REST, **change})

    assert f"({reading})" in violation.text


def test_a_bit_that_an_old_ssw07_does_not_have_does_not_keep_it_from_being_stopped() -> None:
    points = {**WEG_AT_REST, "full_voltage": False, "jog": None, "braking": None, "reversing": None}

    assert broken("ssw07", ("is_stopped",), points) == []


def test_a_violation_says_what_was_read_and_what_to_do() -> None:
    (violation,) = check(load_profile("ssw07"), ("remote",), {"remote": False})

    assert violation.text == "the starter is in local mode (remote is false); switch it to remote"
    assert violation.code == "in_local"


@pytest.mark.parametrize(
    ("rule", "bad", "code"),
    [
        ("remote", {"remote": False}, "in_local"),
        ("general_enabled", {"general_enabled": False}, "not_enabled"),
        ("no_fault", {"fault": True}, "fault_active"),
        ("has_fault", {"fault": False}, "no_fault_to_reset"),
        ("is_ready", {"power_present": False}, "not_ready"),
        ("is_ready", {"running": True}, "motor_running"),
        ("is_ready", {"fault": True}, "fault_active"),
        ("is_ready", {"general_enabled": None}, "state_unknown"),
        ("is_stopped", {"running": True}, "motor_running"),
        ("power_present", {"power_present": False}, "no_power"),
        ("remote", {"remote": None}, "state_unknown"),
        ("no_fault", {"fault": None}, "state_unknown"),
        ("is_stopped", {"running": None}, "state_unknown"),
    ],
)
def test_a_code_says_what_is_wrong_and_never_what_would_have_been_right(
    rule: str, bad: dict[str, Any], code: str
) -> None:
    points = {**WEG_AT_REST, "current_limit": False, "full_voltage": False, **bad}

    (violation,) = check(load_profile("ssw06"), (rule,), points)

    assert violation.code == code
    assert "required" not in violation.text


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("rule", sorted(RULES))
def test_the_points_of_a_rule_are_points_of_the_family(family: str, rule: str) -> None:
    profile = load_profile(family)

    assert set(points_needed(profile, (rule,))) <= set(profile.points)


def test_the_points_that_decide_readiness_include_the_adjusting_mode_of_the_ssw06() -> None:
    assert {"vb06", "general_enabled", "power_present", "running"} <= set(
        points_needed(load_profile("ssw06"), ("is_ready",))
    )
