"""What state a starter is in, and which faults and alarms are active, told from its points alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.families.profile.schema import Alarm, Profile

STATES = ("ready", "starting", "running", "stopping", "fault", "not_ready", "unknown")

# The SSW900 between an accepted start and the ramp: initial test, time before start (ssw900 S5.1).
STARTING = ("s5_1_1_3", "s5_1_1_12")

# The SSW900 after a stop (ssw900 S5.1 bit 13, C5.7.2): "re-start delay", in which it is not ready.
WAITING = ("s5_1_1_13",)

# Points any of which says that the motor turns or is about to; a family has some of them.
MOVING = ("running", "accelerating", "decelerating", "full_voltage", "jog", "braking", "reversing", *STARTING)

ADJUSTING_ROW = "VB06"  # ssw06-es 4.2.4: not 0 while the motor cannot be run


def state_of(profile: Profile, points: Mapping[str, Any]) -> str:
    """Return one of `STATES`; not to know a deciding point makes it `unknown`, never a guess."""
    for name, state in _ORDER[profile.state_rule]:
        value = points.get(name)
        if value is None and is_decisive(profile, name):
            return "unknown"
        if value:
            return state
    return _standstill(profile, points)


def alarms_of(profile: Profile, points: Mapping[str, Any]) -> tuple[Alarm, ...]:
    """Return the faults and alarms that are active now, faults first, each code once."""
    if profile.state_rule == "sst":
        found = _sst_alarms(profile, points)
    elif profile.family == "ssw900":
        found = _ssw900_alarms(profile, points)
    else:
        found = _ssw06_alarms(profile, points)
    return tuple({alarm.code: alarm for alarm in found}.values())


def hindrance(profile: Profile, points: Mapping[str, Any]) -> str:
    """Return in words what keeps a motor at rest from being started; empty when nothing does."""
    for name in _READINESS[profile.state_rule]:
        value = points.get(name)
        if value is False or (value is None and is_decisive(profile, name)):
            return f"{name}{IS_UNKNOWN}" if value is None else f"{name} is false"
    if any(points.get(name) for name in points_on(profile, ADJUSTING_ROW)):
        return f"it is in an adjusting mode ({ADJUSTING_ROW})"
    return "the time after a stop is not over" if any(points.get(name) for name in WAITING) else ""


def alarm_code(letter: str, number: int) -> str:
    """Return an alarm's code as the manuals print it, in lower case: e05 (SSW-07), f005, a128 (SSW900)."""
    return f"{letter}{number:0{2 if letter == 'e' else 3}d}"


def alarm_label(profile: Profile, code: str) -> str:
    """Return an alarm's code with its text, as far as the profile has it."""
    text = next((alarm.text for alarm in profile.alarms if alarm.code == code), "")
    return f"{code.upper()} {text}".rstrip()


def is_decisive(profile: Profile, name: str) -> bool:
    """Return whether not knowing this point leaves the state open: the family has it, whatever its firmware.

    The SSW-07 has jog, braking and reversal from V1.4x on only (ssw07 4.2.1).
    """
    return name in profile.points and not profile.points[name].since_firmware


def points_on(profile: Profile, code: str) -> tuple[str, ...]:
    """Return the names of the points that are told from this row."""
    return tuple(name for name, point in profile.points.items() if point.code == code)


# The first point that is true gives the state. VB01 bit 0 drops while the motor still decelerates
# (ssw06-es 4.2.2), hence the ramps come before `running`.
_ORDER: dict[str, tuple[tuple[str, str], ...]] = {
    "weg": (
        ("fault", "fault"),
        *((name, "starting") for name in STARTING),
        ("accelerating", "starting"),
        ("decelerating", "stopping"),
        ("running", "running"),
        ("jog", "running"),
        ("braking", "running"),
        ("reversing", "running"),
    ),
    "sst": (  # coil 9, then register 19
        ("fault", "fault"),
        ("accelerating", "starting"),
        ("full_voltage", "running"),
        ("decelerating", "stopping"),
    ),
}

IS_UNKNOWN = " is unknown"

# What must be true of a motor at rest to be ready for a start.
_READINESS: dict[str, tuple[str, ...]] = {
    "weg": ("general_enabled", "power_present"),
    "sst": ("configured", "ready_to_start"),  # coils 5 and 26
}


def _standstill(profile: Profile, points: Mapping[str, Any]) -> str:
    found = hindrance(profile, points)
    if found.endswith(IS_UNKNOWN):
        return "unknown"
    return "not_ready" if found else "ready"


def _ssw06_alarms(profile: Profile, points: Mapping[str, Any]) -> list[Alarm]:
    """SSW-06, SSW-07 and SSW-08: bits of VB01, and the fault's number where the family gives one."""
    found = []
    if points.get("fault"):
        number = points.get("fault_code")
        code = alarm_code("e", number) if number else ""
        found.append(_alarm(profile, code, "fault", f"Fault {code.upper()}") if code else _fault(profile))
    if points.get("alarm"):
        found.append(_generic_alarm(profile))
    return found


def _ssw900_alarms(profile: Profile, points: Mapping[str, Any]) -> list[Alarm]:
    """Bits 15 and 14 of S5.1.1 say that there is something, D1.1.1 and D2.1.1-D2.1.5 what [ssw900 S5.1]."""
    found = []
    number = points.get("fault_code")
    if points.get("fault") is not False and number:
        found.append(_alarm(profile, alarm_code("f", number), "fault", f"Fault {number}"))
    elif points.get("fault"):
        found.append(_fault(profile))
    # Five places; whether gaps occur is not stated, so all of them are looked at.
    numbers = [points.get(f"d2_1_{place}") for place in range(1, 6)]
    known = [number for number in numbers if number]
    if points.get("alarm") is not False and known:
        found += [_alarm(profile, alarm_code("a", number), "alarm", f"Alarm {number}") for number in known]
    elif points.get("alarm"):
        found.append(_generic_alarm(profile))
    return found


def _sst_alarms(profile: Profile, points: Mapping[str, Any]) -> list[Alarm]:
    """Coil 9 says that there is an error, coils 10-21 which one."""
    found = [
        _alarm(profile, f"coil{coil}", "fault", f"Error of coil {coil}")
        for coil in range(10, 22)
        if any(points.get(name) for name in points_on(profile, f"COIL{coil}"))
    ]
    return found or ([_fault(profile)] if points.get("fault") else [])


def _fault(profile: Profile) -> Alarm:
    return _alarm(profile, "fault", "fault", "Fault, its number is not known")


def _generic_alarm(profile: Profile) -> Alarm:
    return _alarm(profile, "alarm", "alarm", "Alarm, its number is not known")


def _alarm(profile: Profile, code: str, severity: str, text: str) -> Alarm:
    """Return the profile's alarm of this code, else one with this text."""
    named = next((alarm for alarm in profile.alarms if alarm.code == code), None)
    return named or Alarm.model_validate({"code": code, "severity": severity, "text": text})
