"""The state of a starter, its alarms, and what a command demands of it: which reading breaks which rule."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.families.command.interlock import check
from gateway.families.devices import device_of
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.families.profile.state import hindrance, state_of
from tests.families.notation import table

WEG = "running=0 jog=0 accelerating=0 decelerating=0 braking=0 reversing=0 fault=0 general_enabled=1"
WEG += " power_present=1 remote=1 current_limit=0 full_voltage=0"
AT_REST = {
    "ssw06": WEG,
    "ssw07": WEG,
    "ssw900": " ".join((WEG, *(f"{name}=0" for name in load_profile("ssw900").state.starting))),
    "sst": "fault=0 running=0 accelerating=0 full_voltage=0 decelerating=0 configured=1 ready_to_start=1"
    " coil7=0 coil8=0",
}

SPELT = {"0": False, "1": True, "?": None}


def points(text: str) -> dict[str, Any]:
    """Return points as they are read: `running=1 fault_code=28 jog=?`, a later one over an earlier one."""
    words = dict(each.split("=") for each in text.split())
    return {name: SPELT[word] if word in SPELT else int(word) for name, word in words.items()}


STATES = """
ssw06, ssw07, ssw900 | fault=?            | unknown
ssw06, ssw07, ssw900 | running=?          | unknown
ssw06, ssw07, ssw900 | accelerating=?     | unknown
ssw06, ssw07, ssw900 | general_enabled=?  | unknown
ssw06, ssw07, ssw900 | fault=1 running=?  | fault
ssw900               | power_present=?    | ready
ssw900               | s5_1_1_13=1 running=1 | running
ssw06                | vb06=?             | ready
ssw07                | jog=? braking=? reversing=? | ready
sst                  | configured=?       | unknown
sst                  | decelerating=?     | unknown
"""  # the ssw900 has no power_present, old firmware of the ssw07 no jog


@pytest.mark.parametrize(("families", "changes", "state"), table(STATES))
def test_what_decides_and_is_not_known_leaves_the_state_open(families: str, changes: str, state: str) -> None:
    """What the words of each family give: tests/scenarios/values/test_states.py."""
    for family in families.split(", "):
        assert state_of(load_profile(family), points(f"{AT_REST[family]} {changes}")) == state


HINDRANCES = """
ssw900 | s5_1_1_13=1       | the time after a stop is not over
ssw07  | general_enabled=0 | general_enabled is false
ssw07  | power_present=?   | power_present is unknown
ssw06  | vb06=2            | it is in an adjusting mode (VB06)
sst    | ready_to_start=0  | ready_to_start is false
sst    |                   |
"""


@pytest.mark.parametrize(("family", "changes", "why"), table(HINDRANCES))
def test_what_keeps_a_motor_from_being_started_is_said_in_words(family: str, changes: str, why: str) -> None:
    assert hindrance(load_profile(family), points(f"{AT_REST[family]} {changes}")) == why


ALARMS = """
ssw07  | fault=1 fault_code=28 | e28 fault Serial communication inactive
ssw07  | fault=1 fault_code=42 | e42 fault Fault E42 (not in the manual)
ssw07  | fault=1 fault_code=?  | fault fault
ssw07  | fault=1 fault_code=0  | fault fault
ssw07  | fault=0 fault_code=5  |
ssw06  | fault=1 alarm=1       | fault fault, alarm alarm
ssw900 | fault=1 fault_code=2 alarm=1 d2_1_1=128 d2_1_3=2 d2_1_5=128 | f002 fault, a128 alarm, a002 alarm
ssw900 | fault=1 fault_code=999 alarm=1 d2_1_2=998 | f999 fault Fault F999 (not, a998 alarm Alarm A998
ssw900 | fault=1 fault_code=0  | fault fault
ssw900 | alarm=1 d2_1_1=0      | alarm alarm
ssw900 | fault=0 fault_code=5 alarm=0 d2_1_1=5 |
sst    | fault=1 coil12=1 coil17=1 coil13=? | coil12 fault Overcurrent, coil17 fault Phase loss
sst    | fault=1               | fault fault
sst    | fault=?               |
"""  # the number of the last fault, which is over, is none; nor is an alarm that the status denies


@pytest.mark.parametrize(("family", "text", "alarms"), table(ALARMS))
def test_faults_and_alarms_are_named(family: str, text: str, alarms: str) -> None:
    profile = load_profile(family)

    found = device_of(profile).alarms(profile, points(text))

    expected = alarms.split(", ") if alarms else []
    assert len(found) == len(expected)
    for one, begins in zip(found, expected, strict=True):
        assert f"{one.code} {one.severity} {one.text}".startswith(begins)


def codes(family: str, rule: str, text: str) -> list[str]:
    return [violation.code for violation in check(load_profile(family), (rule,), points(text))]


RULES = """
ssw06 | remote          | remote=?          | state_unknown
ssw06 | is_ready        | power_present=0   | not_ready
ssw06 | is_ready        | running=1         | motor_running
ssw06 | is_ready        | fault=1           | fault_active
ssw06 | is_ready        | general_enabled=? | state_unknown
ssw06 | is_stopped      | braking=1         | motor_running
ssw06 | is_stopped      | running=?         | state_unknown
sst   | serial_controls | coil7=1           |
sst   | serial_controls | coil8=?           |
sst   | is_stopped      | full_voltage=1    | motor_running
"""


@pytest.mark.parametrize(("family", "rule", "bad", "code"), table(RULES))
def test_a_reading_breaks_a_rule_with_a_code_that_says_what_is_wrong(
    family: str, rule: str, bad: str, code: str
) -> None:
    assert codes(family, rule, AT_REST[family]) == []

    (violation,) = check(load_profile(family), (rule,), points(f"{AT_REST[family]} {bad}"))

    assert code in ("", violation.code)
    assert "required" not in violation.text  # never what would have been right


def test_an_unknown_reading_breaks_a_rule() -> None:
    for family, rules in (
        ("ssw07", ("remote", "general_enabled", "no_fault", "has_fault", "is_ready", "is_stopped")),
        ("sst", ("serial_controls", "configured", "is_ready", "is_stopped")),
    ):
        assert [len(codes(family, rule, "")) for rule in rules] == [1] * len(rules)


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
    known = {**points(AT_REST[family]), "remote": False, **row}

    assert (not check(load_profile(family), ("remote",), known, variant=Variant(slot=slot))) is is_obeyed
    assert check(load_profile(family), ("remote",), {**known, "remote": None})  # it is not known where it is


def test_a_bit_that_an_old_ssw07_does_not_have_does_not_keep_it_from_being_stopped() -> None:
    assert codes("ssw07", "is_stopped", f"{WEG} jog=? braking=? reversing=?") == []
