"""The readings of points: what each said last, when that was, and what one reply has brought."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import isfinite
from typing import NamedTuple

from gateway.contract import Quality

Value = bool | int | float | str | None


class Reading(NamedTuple):
    """What one point says, with its quality."""

    value: Value
    unit: str
    quality: Quality
    label: str | None = None  # of an enum
    reason: str = ""  # why a value is bad, where that is not the point's own matter


Points = Mapping[str, Reading]  # by name
NO_POINTS: Points = {}


class Moment(NamedTuple):
    """When a reply left the wire."""

    at_s: float  # steady clock
    time_s: float  # UTC


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


def bad(points: Points, names: Iterable[str], reason: str = "") -> Points:
    """Return these points without their values: the starter does not give them, or they mean nothing."""
    return {name: Reading(None, points[name].unit, Quality.BAD, None, reason) for name in names}


def stale(points: Points, names: Iterable[str]) -> Points:
    """Return the good ones of these points as no longer current; the value stays."""
    known = {name: points[name] for name in names}
    return {name: r._replace(quality=Quality.STALE) for name, r in known.items() if r.quality is Quality.GOOD}


def good_values(points: Points) -> dict[str, Value]:
    """Return the values of the points that are good."""
    good = Quality.GOOD
    return {name: known.value for name, known in points.items() if known.quality is good}
