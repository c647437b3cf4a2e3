"""The state of a starter, computed from its points and the profile's `[state]` alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_args

from gateway.contract import StarterState
from gateway.families.profile.schema import Profile

STATES: tuple[StarterState, ...] = get_args(StarterState)

_MOVING = ("running", "accelerating", "decelerating", "full_voltage", "jog", "braking", "reversing")

IS_UNKNOWN = " is unknown"


def moving(profile: Profile) -> tuple[str, ...]:
    """Return the points any of which says that the motor turns or is about to; a family has some of them."""
    return (*_MOVING, *profile.state.starting)


def state_of(profile: Profile, points: Mapping[str, Any]) -> StarterState:
    """Return one of `STATES`; not to know a deciding point makes it `unknown`, never a guess."""
    for name, state in profile.state.order.items():
        value = points.get(name)
        if value is None and is_decisive(profile, name):
            return "unknown"
        if value:
            return state
    found = hindrance(profile, points)
    if found.endswith(IS_UNKNOWN):
        return "unknown"
    return "not_ready" if found else "ready"


def hindrance(profile: Profile, points: Mapping[str, Any]) -> str:
    """Return in words what keeps a motor at rest from being started; empty when nothing does."""
    state = profile.state
    for name in state.ready:
        value = points.get(name)
        if value is False or (value is None and is_decisive(profile, name)):
            return f"{name}{IS_UNKNOWN}" if value is None else f"{name} is false"
    if points.get(state.adjusting):
        return f"it is in an adjusting mode ({profile.points[state.adjusting].code})"
    return "the time after a stop is not over" if any(points.get(name) for name in state.waiting) else ""


def is_decisive(profile: Profile, name: str) -> bool:
    """Return whether not knowing this point leaves the state open: the family has it, whatever its firmware.

    The SSW-07 has jog, braking and reversal from V1.4x on only (ssw07 4.2.1).
    """
    return name in profile.points and profile.points[name].source not in profile.since_firmware
