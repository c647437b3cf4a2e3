"""Is a starter ready for remote control: what its own settings mean, rule by rule."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.families.devices.device import Identity
from gateway.families.devices.findings import Remark, Topic, Weight
from gateway.families.diagnosis.identification import slot_trouble
from gateway.families.diagnosis.readiness_check import readiness, refuses_start, watchdogs
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.schema import Variant
from tests.families.notation import table

WEG = "P220=6 P229=0 P230=2 P277=0 P278=0 P314=0"
GOOD = {
    "ssw07": f"{WEG} P313=1 P630=0",
    "ssw06": f"{WEG} P313=0 P279=0 P630=0 VB06=0",
    "ssw900": "C3.1=10 C3.2=0 C3.3=4 C8.2.5.1=0 C8.2.5.2=1 C8.2.5.3=0 S3.5.1=2 S3.5.2=0",
    "sst": "COIL5=1 COIL7=0 COIL8=0 COIL26=1 R41=0 R42=0",
}


def known(family: str, changes: str, slot: int | None) -> tuple[Variant, dict[str, Any]]:
    """Return the variant, and good settings with some changes (`P314=?` takes a reading away)."""
    settings = dict(each.split("=") for each in f"{GOOD[family]} {changes}".split())
    variant = Variant(slot=slot if family == "ssw900" else None)
    return variant, {code: (int(number),) for code, number in settings.items() if number != "?"}


def look(family: str, changes: str = "", *, slot: int | None = 1, **times: Any) -> tuple[Remark, ...]:
    return readiness(load_profile(family), *known(family, changes, slot), **times)


def problems(findings: tuple[Remark, ...]) -> list[str]:
    return [finding.text for finding in findings if finding.weight is not Weight.NOTE]


@pytest.mark.parametrize("family", FAMILIES)
def test_a_starter_that_is_set_up_for_the_network_is_ready(family: str) -> None:
    findings = look(family)

    assert problems(findings) == []
    assert not refuses_start(findings)


LOOKS = """
ssw06 | P230=1 | error | P230 = 1 (DI)
ssw07 | P230=0 | error | P230 = 0 (Keypad)
ssw07 | P220=0 | error | P220 = 0 (Always Local)
ssw06 | VB06=2 | error | VB06 = 2
ssw900 | C3.3=5 | error | C3.3 = 5 (Slot 2)
ssw900 | C3.1=0 | error | C3.1 = 0 (Always LOC)
sst | COIL7=1 | error | coil 7
sst | COIL8=1 | error | coil 8
sst | COIL5=0 | error | configure
sst | COIL26=0 | error | coil 26
ssw06 | P220=0 P229=2 P230=0 | note | in local mode the commands of this line act
ssw07 | P220=4 P229=2 | note | in local mode the commands of this line act
ssw900 | C3.1=0 C3.2=4 C3.3=1 | note | in local mode the commands of this line act
ssw07 | P220=4 | note | somebody else chooses local or remote, and in local mode a start is refused: P220
ssw900 | C3.1=4 | note | somebody else chooses local or remote, and in local mode a start is refused: C3.1
ssw07 | P230=? | warning | P230 could not be read
ssw900 | C3.3=? | warning | C3.3 could not be read
sst | COIL8=? | warning | COIL8 could not be read
ssw07 | P314=? | warning | P314 could not be read
ssw900 | C8.2.5.1=1 | warning | 0.0 s
sst | R41=5 R42=5 | warning | R42
sst | R41=5 R42=4 | warning | R42
sst | R41=5 R42=6 | note | R42
"""  # family, settings, the worst that is found, a part of its text (E-23: R42 acts before R41)


@pytest.mark.parametrize(("family", "changes", "weight", "text"), table(LOOKS))
def test_settings_are_found_by_their_weight_and_an_error_refuses_a_start(
    family: str, changes: str, weight: str, text: str
) -> None:
    findings = look(family, changes)

    assert findings[0].weight == weight
    assert any(text in each.text for each in findings if each.weight == weight)
    assert refuses_start(findings) == (weight == "error")


def test_an_accessory_in_slot_2_is_its_own_source_and_an_unknown_slot_refuses_every_command() -> None:
    assert problems(look("ssw900", "C3.1=12 C3.3=5 S3.5.1=0 S3.5.2=2", slot=2)) == []
    assert refuses_start(look("ssw900", slot=2))
    assert "slot" in look("ssw900", slot=None)[0].text


def test_nothing_is_said_of_local_mode_where_it_is_always_remote_nor_of_a_watchdog_that_is_not_known() -> (
    None
):
    for family, changes in (("ssw07", "P220=1"), ("ssw900", "C3.1=1")):
        assert not any(finding.topic is Topic.LOCAL for finding in look(family, changes))
    assert not any("no watchdog" in finding.text for finding in look("ssw07", "P314=?"))


WATCHDOGS = """
ssw06 | P314=3 P313=0 | P314 3 off
ssw06 | P314=3 P313=4 | P314 3 off
ssw06 | P314=3 P313=5 | P314 3
ssw07 | P314=3 P313=1 | P314 3
ssw07 | P314=3 P313=1 P230=1 | P314 3 off
ssw07 | P314=3 P313=2 P230=1 | P314 3
ssw07 | P314=3 P313=3 | P314 3
ssw07 | P314=3 P313=3 P220=2 | P314 3 off
ssw900 | C8.2.5.1=1 C8.2.5.3=15 | C8.2.5.3 1.5
ssw900 | C8.2.5.1=2 C8.2.5.3=15 | C8.2.5.3 1.5
ssw900 | C8.2.5.1=2 C8.2.5.2=0 C8.2.5.3=15 | C8.2.5.3 1.5 off
ssw900 | C8.2.5.1=2 C8.2.5.3=15 C3.3=1 | C8.2.5.3 1.5 off
ssw900 | C8.2.5.1=2 C8.2.5.3=0 | none
sst | R41=9 R42=4 | R42 4, R41 9
"""  # family, settings, what acts by time; `off`: the motor does not feel it


@pytest.mark.parametrize(("family", "changes", "expected"), table(WATCHDOGS))
def test_a_watchdog_is_reported_with_its_time_and_whether_the_motor_feels_it(
    family: str, changes: str, expected: str
) -> None:
    found = watchdogs(load_profile(family), *known(family, changes, 1))

    acts = [f"{each.code} {each.after_s:g}{'' if each.is_felt else ' off'}" for each in found]
    assert (", ".join(acts) or "none") == expected


@pytest.mark.parametrize(
    ("gap_s", "weight"), [(None, Weight.NOTE), (1.0, Weight.NOTE), (2.5, Weight.WARNING), (3.0, Weight.ERROR)]
)
def test_the_poll_plan_is_held_against_the_watchdog(gap_s: float | None, weight: Weight) -> None:
    (finding,) = [f for f in look("ssw07", "P314=3", gap_s=gap_s) if f.topic is Topic.WATCHDOG]

    assert finding.weight is weight
    assert "after 3 s" in finding.text


def test_a_configured_slot_that_the_accessory_does_not_sit_in_is_an_error() -> None:
    trouble = slot_trouble(load_profile("ssw900"), Variant(slot=2), Identity(slot=1))
    found = readiness(load_profile("ssw900"), *known("ssw900", "", 1), slot_trouble=trouble)

    assert problems(found) == [trouble]
    assert trouble.startswith("slot = 2 is configured, but the RS-485 accessory sits in slot 1")
    assert refuses_start(found)


CONFIGURED = """
ssw07 | P314=30 | 10 | watchdog_s = 10 is configured, but the starter's own is set to 30 s: P314
ssw07 | P314=0 | 10 | watchdog_s = 10 is configured, but the starter's own is off: P314
ssw06 | P314=30 | 0 | watchdog_s = 0 is configured, but the starter's own is set to 30 s
sst | R41=8 R42=20 | 20 | but the starter's own is set to 8 s
ssw900 | C8.2.5.1=1 C8.2.5.3=34 | 3 | is set to 3.4 s: C8.2.5.1
ssw07 | P314=30 | 30 |
ssw07 | P314=0 | 0 |
ssw07 | P314=30 | |
ssw07 | P314=? | 30 |
"""


@pytest.mark.parametrize(("family", "changes", "watchdog_s", "text"), table(CONFIGURED))
def test_a_configured_watchdog_that_the_starter_does_not_have_is_said(
    family: str, changes: str, watchdog_s: str, text: str
) -> None:
    findings = look(family, changes, watchdog_s=float(watchdog_s) if watchdog_s else None)

    said = [each for each in problems(findings) if "watchdog_s" in each]

    assert len(said) == bool(text)
    assert all(text in each for each in said)
