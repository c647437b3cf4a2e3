"""Rules that must hold on fresh points before a command is written; an unknown reading breaks a rule.

In local mode a starter obeys this line only where one of its own settings says so (`local_source`): that row
is then among what was read, and what decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gateway.contract import CommandError, Reason, ResultCode
from gateway.families.profile.procedure import Seen
from gateway.families.profile.schema import Profile, Variant
from gateway.families.profile.state import IS_UNKNOWN, hindrance, is_decisive, moving, state_of

RULES: dict[str, ResultCode] = {  # what is wrong where one does not hold, never what would have been right
    "remote": ResultCode.IN_LOCAL,
    "serial_controls": ResultCode.CONTROLLED_ELSEWHERE,
    "general_enabled": ResultCode.NOT_ENABLED,
    "no_fault": ResultCode.FAULT_ACTIVE,
    "has_fault": ResultCode.NO_FAULT_TO_RESET,
    "is_ready": ResultCode.NOT_READY,
    "configured": ResultCode.NOT_CONFIGURED,
    "is_stopped": ResultCode.MOTOR_RUNNING,
    "power_present": ResultCode.NO_POWER,
}

_UNKNOWN = Variant()

_STATE_CODES = {  # of `is_ready`, where the state says more
    "fault": ResultCode.FAULT_ACTIVE,
    "starting": ResultCode.MOTOR_RUNNING,
    "running": ResultCode.MOTOR_RUNNING,
    "stopping": ResultCode.MOTOR_RUNNING,
}


def local_source(profile: Profile, variant: Variant) -> tuple[str, int] | None:
    """Return the row that gives the commands in local mode to this line, and its number then; None: none."""
    local = profile.local_control
    if local is None or (variant.slot is None and len(local.serial) > 1):
        return None
    return local.code, local.serial[(variant.slot or 1) - 1 if len(local.serial) > 1 else 0]


def check(
    profile: Profile, rules: Sequence[str], points: Mapping[str, Any], *, variant: Variant = _UNKNOWN
) -> tuple[CommandError, ...]:
    """Return a refusal for each rule that does not hold on these points, with what was read.

    The row of `local_source` counts where its raw words are among the points, by its code.
    """
    refusals = []
    for rule in rules:
        reading = _reading(profile, rule, points)
        if rule == "remote" and points.get(rule) is False and _obeys_in_local(profile, variant, points):
            continue
        if reading is not None:
            refusals.append(_refusal(profile, rule, reading, points))
    return tuple(refusals)


def _obeys_in_local(profile: Profile, variant: Variant, points: Mapping[str, Any]) -> bool:
    source = local_source(profile, variant)
    return source is not None and points.get(source[0]) == (source[1],)


def demand(
    profile: Profile, rules: Sequence[str], points: Mapping[str, Any], *, variant: Variant = _UNKNOWN
) -> None:
    """Raise CommandError, with the first broken rule's code, unless all these rules hold on these points."""
    refusals = check(profile, rules, points, variant=variant)
    if refusals:
        reasons: dict[str, Reason] = {}
        for refusal in refusals:
            # The state may say once more what a rule has said; each unknown reading is another one.
            is_unknown = refusal.code == ResultCode.STATE_UNKNOWN
            reasons.setdefault(refusal.text if is_unknown else refusal.code, refusal.reason)
        first, *others = reasons.values()
        raise CommandError(first.noted(*others))


def check_set_to_serial(profile: Profile, needs: Mapping[str, tuple[int, ...]], seen: Seen) -> None:
    """Raise not_set_to_serial when a row was seen to hold none of the numbers that are needed of it."""
    for code, numbers in needs.items():
        if code in seen and seen[code][0] not in numbers:
            labels = profile.enums[profile.parameters[code].enum]
            wanted = " or ".join(f"{number} ({labels[number]})" for number in numbers)
            found = f"{seen[code][0]} ({labels.get(seen[code][0])})"
            raise CommandError(ResultCode.NOT_SET_TO_SERIAL, row=code, found=found, wanted=wanted)


def _refusal(profile: Profile, rule: str, reading: str, points: Mapping[str, Any]) -> CommandError:
    state = state_of(profile, points) if rule == "is_ready" else ""
    if reading.endswith(IS_UNKNOWN) or state == "unknown":
        return CommandError(ResultCode.STATE_UNKNOWN, rule, reading=reading)
    return CommandError(_STATE_CODES.get(state, RULES[rule]), reading=reading)


def points_needed(profile: Profile, rules: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the points on which these rules are checked, as far as the family has them."""
    names = [name for rule in rules for name in _needed(profile, rule)]
    return tuple(dict.fromkeys(name for name in names if name in profile.points))


def _needed(profile: Profile, rule: str) -> tuple[str, ...]:
    state = profile.state
    if rule == "is_ready":
        return ("fault", *state.ready, *moving(profile), *state.waiting, state.adjusting)
    if rule == "serial_controls":
        return profile.points["remote"].none_of  # where one of these is true, another is in control
    if rule == "is_stopped":
        return moving(profile)
    return ("fault",) if rule in ("no_fault", "has_fault") else (rule,)


def _reading(profile: Profile, rule: str, points: Mapping[str, Any]) -> str | None:
    """Return what was read where a rule does not hold, None when it does."""
    match rule:
        case "is_ready":
            return _state(profile, points)
        case "is_stopped" | "serial_controls":  # none of these points is true
            names = _needed(profile, rule)
            known = (name for name in names if points.get(name) is not None or is_decisive(profile, name))
            readings = (_other_than(points, name, is_on=False) for name in known)
            return next(filter(None, readings), None)
        case "no_fault" | "has_fault":
            return _other_than(points, "fault", is_on=rule == "has_fault")
        case _:  # named as the point that must be true
            return _other_than(points, rule, is_on=True)


def _other_than(points: Mapping[str, Any], name: str, *, is_on: bool) -> str | None:
    value = points.get(name)
    if value is None:
        return f"{name}{IS_UNKNOWN}"
    return None if bool(value) is is_on else f"{name} is {str(value).lower()}"


def _state(profile: Profile, points: Mapping[str, Any]) -> str | None:
    state = state_of(profile, points)
    if state == "ready":
        return None
    why = hindrance(profile, points) if state in ("not_ready", "unknown") else ""
    return f"the state is {state}: {why}" if why else f"the state is {state}"
