"""What is known of one starter, point by point and row by row, and how far it can be trusted."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from gateway.contract import Quality
from gateway.families import decode

Value = bool | int | float | str | None


class Reading(NamedTuple):
    """One point's value with where and when it comes from."""

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


class Snapshot:
    """The readings of one starter; every point is there from the beginning, bad until it is read."""

    def __init__(self, units: Mapping[str, str]) -> None:
        self._readings = {name: Reading(None, unit, Quality.BAD) for name, unit in units.items()}
        self._changed = dict.fromkeys(self._readings)  # points since `take_changed`, in their order
        self.standing = 0  # grows whenever anything but a measured quantity says something else
        self._rows: dict[str, tuple[int, ...]] = {}
        self._rows_at_s: dict[str, float] = {}
        self.distrust_reason = ""  # why every value is bad, as `distrust` said; empty: it is not

    @property
    def readings(self) -> Mapping[str, Reading]:
        """Return all points' readings by name."""
        return self._readings

    @property
    def rows(self) -> Mapping[str, tuple[int, ...]]:
        """Return the raw words read last, by the manual's code, however old."""
        return self._rows

    def apply(self, decoded: Mapping[str, decode.Decoded], *, at_s: float, time_s: float) -> None:
        """Record points just read; a value that cannot be decoded is bad, an older one is ignored."""
        for name, new in decoded.items():
            old = self._readings[name]
            if old.at_s is not None and old.at_s > at_s:
                continue
            quality = Quality.BAD if new.value is None else Quality.GOOD
            reading = Reading(new.value, new.unit, quality, new.label, at_s, time_s)
            self._put(name, self._without_value(reading) if self.distrust_reason else reading)

    def distrust(self, reason: str) -> bool:
        """Make every value bad for this reason until it is empty; return whether that is new.

        The raw words are stored all the same. Once the reason is empty, each value is good when it is read.
        """
        if reason == self.distrust_reason:
            return False
        self.distrust_reason = reason
        for name, reading in list(self._readings.items()):
            self._put(name, self._without_value(reading))
        return True

    def keep_rows(self, rows: Mapping[str, tuple[int, ...]], *, at_s: float) -> None:
        """Record raw words that have just been read; older ones than those known are ignored."""
        for code, words in rows.items():
            if self._rows_at_s.get(code, -math.inf) <= at_s:
                self._rows[code] = words
                self._rows_at_s[code] = at_s

    def refuse(self, points: Iterable[str]) -> None:
        """Mark points that the starter will not give as bad, without a value."""
        for name in points:
            self._put(name, self._without_value(self._readings[name]))

    def mark_stale(self, points: Iterable[str] | None = None) -> None:
        """Mark good readings (all, or of these points) as no longer current; value and time stay."""
        for name in list(self._readings) if points is None else points:
            reading = self._readings[name]
            if reading.quality is Quality.GOOD:
                self._put(name, reading._replace(quality=Quality.STALE))

    def take_changed(self) -> Iterable[str]:
        """Return the points that say something else than at the last call; in the first one all of them."""
        if not self._changed:
            return ()
        changed, self._changed = self._changed, {}
        return changed

    def has_good(self) -> bool:
        """Return whether anything is good."""
        return any(known.quality is Quality.GOOD for known in self._readings.values())

    def good_values(self) -> dict[str, Value]:
        """Return the values that were just read, by point."""
        return good_values(self._readings)

    def good_values_of(self, points: Iterable[str], *, at_s: float) -> dict[str, Value]:
        """Return the values of those of these points that were read at this moment, and are good."""
        readings, good = self._readings, Quality.GOOD
        return {
            name: known.value
            for name in points
            if (known := readings[name]).at_s == at_s and known.quality is good
        }

    def age_s(self, point: str, *, now_s: float) -> float:
        """Return how long ago a point was read; infinite when it never was."""
        at_s = self._readings[point].at_s
        return math.inf if at_s is None else now_s - at_s

    def rows_since(self, since_s: float) -> dict[str, tuple[int, ...]]:
        """Return the raw words of all rows that were read at `since_s` or later."""
        return {code: words for code, words in self._rows.items() if self._rows_at_s[code] >= since_s}

    def _without_value(self, reading: Reading) -> Reading:
        return reading._replace(value=None, label=None, quality=Quality.BAD, reason=self.distrust_reason)

    def _put(self, name: str, new: Reading) -> None:
        old = self._readings[name]
        self._readings[name] = new
        is_same_value = old.value == new.value and type(old.value) is type(new.value)
        if (
            is_same_value
            and old.quality is new.quality
            and (old.label, old.reason) == (new.label, new.reason)
        ):
            return  # only its time is new
        self._changed[name] = None
        if old.quality is not new.quality or not (is_same_value or isinstance(new.value, float)):
            self.standing += 1


def good_values(readings: Mapping[str, Reading]) -> dict[str, Value]:
    """Return the values of those readings that are good, by point."""
    return {name: known.value for name, known in readings.items() if known.quality is Quality.GOOD}


def as_flag(value: Value) -> bool | None:
    """Return a boolean value; None for one that is not known."""
    return value if isinstance(value, bool) else None
