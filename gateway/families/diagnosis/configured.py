"""Statements of a configuration that are impossible for a device of the starter's family."""

from __future__ import annotations

from collections.abc import Iterator

from gateway.contract import CommandError
from gateway.families.devices import DEVICES, device_of
from gateway.families.profile.parameters import to_words
from gateway.families.profile.rows import Parameter
from gateway.families.profile.schema import Profile


def wrong_settings(
    profile: Profile, *, model: str | None, watchdog_s: float | None
) -> Iterator[tuple[str, str]]:
    """Return the keys `model` and `watchdog_s` where they cannot be right, each with the reason.

    A model whose name shows no family passes.
    """
    patterns = {family: device.names or device.product for family, device in DEVICES.items()}
    named = [family for family, pattern in patterns.items() if pattern and pattern.search(model or "")]
    if named and profile.family not in named:
        yield "model", f"is the name of a model of {named[0]}, not of {profile.family}"
    if watchdog_s is not None:
        rows = [profile.parameters[code] for code in device_of(profile).watchdog_rows]
        reasons = [_why_not(profile, row, watchdog_s) for row in rows if row.unit == "s"]
        if reasons and all(reasons):
            yield "watchdog_s", f"is no time of its watchdog: {reasons[0]}"


def _why_not(profile: Profile, row: Parameter, value: float) -> str:
    """Return why a row cannot be set to this; empty when it can."""
    try:
        to_words(profile, row, value)
    except CommandError as error:
        return error.text
    return ""
