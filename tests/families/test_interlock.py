"""What a command demands of a starter: which reading breaks which rule, with which code and words."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.families.command.interlock import check
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from tests.families.at_rest import SST_AT_REST, WEG_AT_REST

WEG = {**WEG_AT_REST, "remote": True, "current_limit": False, "full_voltage": False}
SST = {**SST_AT_REST, "coil7": False, "coil8": False}
AT_REST = {"ssw06": WEG, "ssw07": WEG, "ssw900": WEG, "sst": SST}


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
    assert codes("ssw07", "is_stopped", {**WEG, "jog": None, "braking": None, "reversing": None}) == []
