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

SSW07 = {"P220": 6, "P229": 0, "P230": 2, "P277": 0, "P278": 0, "P313": 1, "P314": 0, "P630": 0}
SSW06 = {**SSW07, "P279": 0, "P313": 0, "VB06": 0}
SSW900 = {
    "C3.1": 10,
    "C3.2": 0,
    "C3.3": 4,
    "C8.2.5.1": 0,
    "C8.2.5.2": 1,
    "C8.2.5.3": 0,
    "S3.5.1": 2,
    "S3.5.2": 0,
}
SST = {"COIL5": 1, "COIL7": 0, "COIL8": 0, "COIL26": 1, "R41": 0, "R42": 0}
GOOD = {"ssw06": SSW06, "ssw07": SSW07, "ssw900": SSW900, "sst": SST}


def known(family: str, changes: dict[str, int | None], slot: int | None) -> tuple[Variant, dict[str, Any]]:
    """Return the variant, and good settings with some changes; None takes a reading away."""
    numbers = {**GOOD[family], **changes}
    variant = Variant.model_validate({"slot": slot if family == "ssw900" else None})
    return variant, {code: (number,) for code, number in numbers.items() if number is not None}


def look(
    family: str, changes: dict[str, int | None] | None = None, *, slot: int | None = 1, **times: float | None
) -> tuple[Remark, ...]:
    return readiness(load_profile(family), *known(family, changes or {}, slot), **times)


def problems(findings: tuple[Remark, ...]) -> list[str]:
    return [finding.text for finding in findings if finding.weight is not Weight.NOTE]


def watchdogs_of(
    family: str, changes: dict[str, int | None], slot: int | None = 1
) -> list[tuple[str, float, bool]]:
    found = watchdogs(load_profile(family), *known(family, changes, slot))
    return [(each.code, each.after_s, each.is_felt) for each in found]


@pytest.mark.parametrize("family", FAMILIES)
def test_a_starter_that_is_set_up_for_the_network_is_ready(family: str) -> None:
    findings = look(family)

    assert problems(findings) == []
    assert not refuses_start(findings)


@pytest.mark.parametrize(
    ("family", "changes", "named"),
    [
        ("ssw06", {"P230": 1}, "P230 = 1 (DI)"),
        ("ssw07", {"P230": 0}, "P230 = 0 (Keypad)"),
        ("ssw07", {"P220": 0}, "P220 = 0 (Always Local)"),
        ("ssw06", {"VB06": 2}, "VB06 = 2"),
        ("ssw900", {"C3.3": 5}, "C3.3 = 5 (Slot 2)"),
        ("ssw900", {"C3.1": 0}, "C3.1 = 0 (Always LOC)"),
        ("sst", {"COIL7": 1}, "coil 7"),
        ("sst", {"COIL8": 1}, "coil 8"),
        ("sst", {"COIL5": 0}, "configure"),
        ("sst", {"COIL26": 0}, "coil 26"),
    ],
)
def test_a_setting_that_would_refuse_a_start_is_an_error_that_names_it(
    family: str, changes: dict[str, int | None], named: str
) -> None:
    findings = look(family, changes)

    assert refuses_start(findings)
    assert findings[0].weight is Weight.ERROR
    assert named in findings[0].text


@pytest.mark.parametrize(
    ("family", "changes"),
    [
        ("ssw06", {"P220": 0, "P229": 2, "P230": 0}),
        ("ssw07", {"P220": 4, "P229": 2}),
        ("ssw900", {"C3.1": 0, "C3.2": 4, "C3.3": 1}),
    ],
)
def test_a_starter_that_obeys_the_line_in_local_mode_is_noted_and_is_no_error(
    family: str, changes: dict[str, int | None]
) -> None:
    findings = look(family, changes)

    assert problems(findings) == []
    assert any("in local mode the commands of this line act" in finding.text for finding in findings)


def test_an_accessory_in_slot_2_is_its_own_source_and_an_unknown_slot_refuses_every_command() -> None:
    assert problems(look("ssw900", {"C3.1": 12, "C3.3": 5, "S3.5.1": 0, "S3.5.2": 2}, slot=2)) == []
    assert refuses_start(look("ssw900", slot=2))
    assert "slot" in look("ssw900", slot=None)[0].text


@pytest.mark.parametrize(("family", "code"), [("ssw07", "P220"), ("ssw900", "C3.1")])
def test_somebody_else_who_chooses_local_or_remote_is_noted_unless_it_is_always_remote(
    family: str, code: str
) -> None:
    findings = look(family, {code: 4})

    assert problems(findings) == []
    assert any("somebody else chooses" in finding.text and code in finding.text for finding in findings)
    assert not any(finding.topic is Topic.LOCAL for finding in look(family, {code: 1}))


@pytest.mark.parametrize(
    ("family", "code"), [("ssw07", "P230"), ("ssw900", "C3.3"), ("sst", "COIL8"), ("ssw07", "P314")]
)
def test_what_could_not_be_read_is_a_warning_and_never_taken_for_good(family: str, code: str) -> None:
    assert any(f"{code} could not be read" in text for text in problems(look(family, {code: None})))
    assert not any("no watchdog" in finding.text for finding in look("ssw07", {"P314": None}))


@pytest.mark.parametrize(
    ("family", "changes", "expected"),
    [
        ("ssw06", {"P314": 3, "P313": 0}, [("P314", 3.0, False)]),
        ("ssw06", {"P314": 3, "P313": 4}, [("P314", 3.0, False)]),
        ("ssw06", {"P314": 3, "P313": 5}, [("P314", 3.0, True)]),
        ("ssw07", {"P314": 3, "P313": 1}, [("P314", 3.0, True)]),
        ("ssw07", {"P314": 3, "P313": 1, "P230": 1}, [("P314", 3.0, False)]),
        ("ssw07", {"P314": 3, "P313": 2, "P230": 1}, [("P314", 3.0, True)]),
        ("ssw07", {"P314": 3, "P313": 3}, [("P314", 3.0, True)]),
        ("ssw07", {"P314": 3, "P313": 3, "P220": 2}, [("P314", 3.0, False)]),
        ("ssw900", {"C8.2.5.1": 1, "C8.2.5.3": 15}, [("C8.2.5.3", 1.5, True)]),
        ("ssw900", {"C8.2.5.1": 2, "C8.2.5.3": 15}, [("C8.2.5.3", 1.5, True)]),
        ("ssw900", {"C8.2.5.1": 2, "C8.2.5.2": 0, "C8.2.5.3": 15}, [("C8.2.5.3", 1.5, False)]),
        ("ssw900", {"C8.2.5.1": 2, "C8.2.5.3": 15, "C3.3": 1}, [("C8.2.5.3", 1.5, False)]),
        ("ssw900", {"C8.2.5.1": 2, "C8.2.5.3": 0}, []),
        ("sst", {"R41": 9, "R42": 4}, [("R42", 4.0, True), ("R41", 9.0, True)]),
    ],
)
def test_a_watchdog_is_reported_with_its_time_and_whether_the_motor_feels_it(
    family: str, changes: dict[str, int | None], expected: list[tuple[str, float, bool]]
) -> None:
    assert watchdogs_of(family, changes) == expected


def test_a_timeout_of_zero_seconds_that_is_on_is_a_warning() -> None:
    assert any("0.0 s" in text for text in problems(look("ssw900", {"C8.2.5.1": 1})))


@pytest.mark.parametrize(("stop_s", "restart_s", "is_warned"), [(5, 5, True), (5, 4, True), (5, 6, False)])
def test_e_23_a_restart_that_comes_before_the_stop_is_a_warning(
    stop_s: int, restart_s: int, *, is_warned: bool
) -> None:
    findings = look("sst", {"R41": stop_s, "R42": restart_s})

    assert any("R42" in text and "R41" in text for text in problems(findings)) is is_warned


@pytest.mark.parametrize(
    ("gap_s", "weight"), [(None, Weight.NOTE), (1.0, Weight.NOTE), (2.5, Weight.WARNING), (3.0, Weight.ERROR)]
)
def test_the_poll_plan_is_held_against_the_watchdog(gap_s: float | None, weight: Weight) -> None:
    (finding,) = [f for f in look("ssw07", {"P314": 3}, gap_s=gap_s) if f.topic is Topic.WATCHDOG]

    assert finding.weight is weight
    assert "after 3 s" in finding.text


def test_a_configured_slot_that_the_accessory_does_not_sit_in_is_an_error() -> None:
    trouble = slot_trouble(load_profile("ssw900"), Variant(slot=2), Identity(slot=1))
    found = readiness(load_profile("ssw900"), *known("ssw900", {}, 1), slot_trouble=trouble)

    assert problems(found) == [trouble]
    assert trouble.startswith("slot = 2 is configured, but the RS-485 accessory sits in slot 1")
    assert refuses_start(found)


@pytest.mark.parametrize(
    ("family", "changes", "watchdog_s", "text"),
    [
        ("ssw07", {"P314": 30}, 10.0, "= 10 is configured, but the starter's own is set to 30 s: P314"),
        ("ssw07", {"P314": 0}, 10.0, "watchdog_s = 10 is configured, but the starter's own is off: P314"),
        ("ssw06", {"P314": 30}, 0.0, "watchdog_s = 0 is configured, but the starter's own is set to 30 s"),
        ("sst", {"R41": 8, "R42": 20}, 20.0, "but the starter's own is set to 8 s"),
        ("ssw900", {"C8.2.5.1": 1, "C8.2.5.3": 34}, 3.0, "is set to 3.4 s: C8.2.5.1"),
        ("ssw07", {"P314": 30}, 30.0, ""),
        ("ssw07", {"P314": 0}, 0.0, ""),
        ("ssw07", {"P314": 30}, None, ""),
        ("ssw07", {"P314": None}, 30.0, ""),
    ],
)
def test_a_configured_watchdog_that_the_starter_does_not_have_is_said(
    family: str, changes: dict[str, int | None], watchdog_s: float | None, text: str
) -> None:
    said = [each for each in problems(look(family, changes, watchdog_s=watchdog_s)) if "watchdog_s" in each]

    assert len(said) == bool(text)
    assert all(text in each for each in said)
