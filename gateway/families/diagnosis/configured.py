"""Statements of a configuration that are impossible for a device of the starter's family."""

from __future__ import annotations

import re
from collections.abc import Iterator

from gateway.contract import CommandError
from gateway.families.devices import DEVICES, device_of
from gateway.families.profile.parameters import to_words
from gateway.families.profile.rows import Parameter
from gateway.families.profile.schema import Profile

_SECONDS = "s"


def wrong_settings(profile: Profile, *, model: object, watchdog_s: object) -> Iterator[tuple[str, str]]:
    """Return the keys `model` and `watchdog_s` where they cannot be right, each with the reason.

    A model whose name shows no family passes, and so does a value of another type.
    """
    if isinstance(model, str):
        named = [
            family for family, device in DEVICES.items() if _names(device.names or device.product, model)
        ]
        if named and profile.family not in named:
            yield "model", f"is the name of a model of {named[0]}, not of {profile.family}"
    if isinstance(watchdog_s, int | float) and not isinstance(watchdog_s, bool) and watchdog_s >= 0:
        rows = [profile.parameters[code] for code in device_of(profile).watchdog_rows]
        reasons = [_why_not(profile, row, watchdog_s) for row in rows if row.unit == _SECONDS]
        if reasons and all(reasons):
            yield "watchdog_s", f"is no time of its watchdog: {reasons[0]}"


def _names(pattern: re.Pattern[str] | None, model: str) -> bool:
    return pattern is not None and pattern.search(model) is not None


def _why_not(profile: Profile, row: Parameter, value: float) -> str:
    """Return why a row cannot be set to this; empty when it can."""
    try:
        to_words(profile, row, value)
    except CommandError as error:
        return error.text
    return ""
