"""The readings of points: the newest of each, and those that one reply has brought."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import isfinite
from typing import NamedTuple

from gateway.contract import Quality
from gateway.families import decode

Value = bool | int | float | str | None


class Reading(NamedTuple):
    """One point's value with its time and its quality."""

    value: Value
    unit: str
    quality: Quality
    label: str | None = None  # of an enum
    at_s: float | None = None  # steady clock; None when never read
    time_s: float | None = None  # the same moment, UTC
    reason: str = ""  # why a value is bad, where that is not the point's own matter

    @property
    def is_good(self) -> bool:
        """Return whether the value was just read."""
        return self.quality is Quality.GOOD

    def bad(self, reason: str = "") -> Reading:
        """Return the reading without its value."""
        return self._replace(value=None, label=None, quality=Quality.BAD, reason=reason)


Points = Mapping[str, Reading]  # by name


class Readings(NamedTuple):
    """The good values of one reply, with the state that follows from all that is known then.

    A point that was not read by this very reply, or that is not good, is not in `values`. The two times are
    of the reply's last byte: `at_s` on the steady clock, by which intervals are computed, `time_s` UTC.
    """

    at_s: float
    time_s: float
    state: str
    values: Mapping[str, Value]

    def number(self, point: str) -> float | None:
        """Return a measured quantity; None when it was not read, or is no finite number."""
        value = self.values.get(point)
        if not isinstance(value, (int, float)) or isinstance(value, bool) or not isfinite(value):
            return None
        return float(value)


def read(points: Points, decoded: Mapping[str, decode.Decoded], *, at_s: float, time_s: float) -> Points:
    """Return the readings of a reply without those that are older than the known ones.

    A value that cannot be known is bad.
    """
    found: dict[str, Reading] = {}
    for name, new in decoded.items():
        known_s = points[name].at_s
        if known_s is None or known_s <= at_s:
            quality = Quality.BAD if new.value is None else Quality.GOOD
            found[name] = Reading(new.value, new.unit, quality, new.label, at_s, time_s)
    return found


def bad(points: Points, names: Iterable[str], reason: str = "") -> Points:
    """Return these points without their values: the starter does not give them, or they mean nothing."""
    return {name: points[name].bad(reason) for name in names}


def stale(points: Points, names: Iterable[str]) -> Points:
    """Return the good ones of these points as no longer current; value and time stay."""
    return {name: points[name]._replace(quality=Quality.STALE) for name in names if points[name].is_good}


def good_values(points: Points) -> dict[str, Value]:
    """Return the values of the points that are good."""
    good = Quality.GOOD
    return {name: known.value for name, known in points.items() if known.quality is good}
