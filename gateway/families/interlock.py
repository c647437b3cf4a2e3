"""Rules that must hold on fresh points before a command is written; an unknown reading breaks a rule."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gateway.families.schema import Profile
from gateway.families.state import ADJUSTING_ROW, MOVING, WAITING, hindrance, is_decisive, points_on, state_of

RULES: dict[str, str] = {
    "remote": "the starter takes commands in remote mode",
    "serial_controls": "neither USB nor the parallel input controls the starter (coils 7 and 8 are 0)",
    "general_enabled": "the starter is generally enabled",
    "no_fault": "no fault is active",
    "has_fault": "a fault is active",
    "is_ready": "the starter is ready for a start",
    "configured": "the configuration of the starter is complete (coil 5 is 1)",
    "is_stopped": "the motor is stopped",
    "power_present": "the power section is supplied",
    "not_adjusting": "the starter is not in an adjusting mode (VB06 is 0)",
}


@dataclass(frozen=True, slots=True)
class Violation:
    """A rule that does not hold: what was read instead, and one line for the operator."""

    rule: str
    reading: str
    text: str


def check(profile: Profile, rules: Sequence[str], points: Mapping[str, Any]) -> tuple[Violation, ...]:
    """Return the rules that do not hold on these points, in the order asked."""
    violations = []
    for rule in rules:
        reading = _CHECKS[rule](profile, points)
        if reading is not None:
            text = f"{RULES[rule]}: required, but {reading}; {_MENDS[rule]}"
            violations.append(Violation(rule=rule, reading=reading, text=text))
    return tuple(violations)


def points_needed(profile: Profile, rules: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the points on which these rules are checked, as far as the family has them."""
    names = [name for rule in rules for name in _needed(profile, rule)]
    return tuple(dict.fromkeys(name for name in names if name in profile.points))


Check = Callable[[Profile, Mapping[str, Any]], str | None]  # None when the rule holds, else the reading

_MENDS: dict[str, str] = {
    "remote": "switch the starter to remote",
    "serial_controls": "give control back to the serial line",
    "general_enabled": "enable the starter (general_enable, or its enable input)",
    "no_fault": "find the cause of the fault, then reset",
    "has_fault": "there is nothing to reset",
    "is_ready": "see the state and the alarms of the starter",
    "configured": "send configure first",
    "is_stopped": "stop the motor first",
    "power_present": "switch the supply of the power section on",
    "not_adjusting": "leave the adjusting mode at the starter",
}

_DECIDING: dict[str, tuple[str, ...]] = {
    "weg": ("fault", "general_enabled", "power_present", *MOVING),
    "sst": ("fault", "configured", "ready_to_start", *MOVING),
}


def _needed(profile: Profile, rule: str) -> tuple[str, ...]:
    if rule == "is_ready":
        return (*_DECIDING[profile.state_rule], *WAITING, *_adjusting(profile))
    if rule == "serial_controls":
        return _foreign_control(profile)
    if rule == "not_adjusting":
        return _adjusting(profile)
    if rule == "is_stopped":
        return MOVING
    return ("fault",) if rule in ("no_fault", "has_fault") else (rule,)


def _foreign_control(profile: Profile) -> tuple[str, ...]:
    return tuple(name for code in ("COIL7", "COIL8") for name in points_on(profile, code))


def _adjusting(profile: Profile) -> tuple[str, ...]:
    return points_on(profile, ADJUSTING_ROW)


def _must_be(name: str, *, is_on: bool) -> Check:
    def read(_profile: Profile, points: Mapping[str, Any]) -> str | None:
        value = points.get(name)
        if value is None:
            return f"{name} is unknown"
        return None if bool(value) is is_on else f"{name} is {_word(value)}"

    return read


def _none_set(names_of: Callable[[Profile], tuple[str, ...]]) -> Check:
    def read(profile: Profile, points: Mapping[str, Any]) -> str | None:
        readings = (_must_be(name, is_on=False)(profile, points) for name in names_of(profile))
        return next((reading for reading in readings if reading is not None), None)

    return read


def _is_stopped(profile: Profile, points: Mapping[str, Any]) -> str | None:
    for name in MOVING:
        if points.get(name):
            return f"{name} is true"
        if points.get(name) is None and is_decisive(profile, name):
            return f"{name} is unknown"
    return None


def _is_ready(profile: Profile, points: Mapping[str, Any]) -> str | None:
    state = state_of(profile, points)
    if state == "ready":
        return None
    why = hindrance(profile, points) if state in ("not_ready", "unknown") else ""
    return f"the state is {state}: {why}" if why else f"the state is {state}"


def _word(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


_CHECKS: dict[str, Check] = {
    "remote": _must_be("remote", is_on=True),
    "serial_controls": _none_set(_foreign_control),
    "general_enabled": _must_be("general_enabled", is_on=True),
    "no_fault": _must_be("fault", is_on=False),
    "has_fault": _must_be("fault", is_on=True),
    "is_ready": _is_ready,
    "configured": _must_be("configured", is_on=True),
    "is_stopped": _is_stopped,
    "power_present": _must_be("power_present", is_on=True),
    "not_adjusting": _none_set(_adjusting),
}
