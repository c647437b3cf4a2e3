"""The readings of the last minute of one starter, in bounded memory, and as a table around a moment.

Each point has two arrays of its own: times and values. Three rules keep them small:

1. A value that does not change has two entries, the first and the latest reading of it.
2. A reading older than `KEEP_S` goes.
3. A point that was read `MOST` times gives up every other reading of its older half: near the present
   nothing is missing.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping
from typing import Any

from gateway.contract import ReadingTable

BEFORE_S = 60.0  # what a record shows of the time before it
KEEP_S = BEFORE_S + 30.0  # a record is finished that much later at most
TRIM_S = 5.0  # old readings go that much later, many at once
MOST = 240  # readings of one point: four a second for a minute
DIGITS = 7  # that a stored value has: 32 bit floating point

Number = bool | int | float


class _PointReadings:
    """The readings of one point."""

    __slots__ = ("is_standing", "kind", "last", "times", "values")

    def __init__(self, kind: type) -> None:
        self.kind = kind
        self.times = array("d")
        self.values = array("f")
        self.last: Number | None = None
        self.is_standing = False  # the last two entries have this value: most flags, most of the time

    def add(self, at_s: float, value: Number) -> None:
        times = self.times
        if times and at_s <= times[-1]:
            return
        is_same = value == self.last
        if is_same and self.is_standing:
            times[-1] = at_s
            return
        self.is_standing, self.last = is_same, value
        times.append(at_s)
        self.values.append(value)
        if len(times) > 2 and at_s - times[1] > KEEP_S + TRIM_S:
            self._trim(at_s - KEEP_S)
        if len(times) >= MOST:
            self._thin()

    def _trim(self, since_s: float) -> None:
        count = 0
        while self.times[count + 1] < since_s:  # one older reading stays: its value may stand into the window
            count += 1
        del self.times[:count]
        del self.values[:count]

    def _thin(self) -> None:
        half = len(self.times) // 2
        self.times = self.times[:half:2] + self.times[half:]
        self.values = self.values[:half:2] + self.values[half:]

    def shown(self, value: float) -> Number:
        """Return a stored value as what it was."""
        if self.kind is float:
            return float(f"{value:.{DIGITS - 1}g}")
        return bool(value) if self.kind is bool else int(value)


class ReadingRing:
    """The readings of one starter; times are on the steady clock, only numbers and flags are stored."""

    __slots__ = ("_series",)

    def __init__(self) -> None:
        self._series: dict[str, _PointReadings] = {}

    def note(self, values: Mapping[str, Any], *, at_s: float) -> None:
        """Add good readings, all of one moment; one that is older than the point's last is ignored."""
        for name, value in values.items():
            if not isinstance(value, (bool, int, float)):
                continue
            series = self._series.get(name)
            if series is None or series.kind is not type(value):
                series = self._series[name] = _PointReadings(type(value))
            series.add(at_s, value)

    def began_s(self, point: str) -> float | None:
        """Return when a flag that is on now was read as on for the first time; None when it is off."""
        series = self._series.get(point)
        if series is None or not series.values or not series.values[-1]:
            return None
        began_s = series.times[-1]
        for at_s, value in zip(reversed(series.times), reversed(series.values), strict=True):
            if not value:
                break
            began_s = at_s
        return began_s

    def around(self, moment_s: float, *, before_s: float = BEFORE_S) -> ReadingTable:
        """Return what was read from `before_s` before a moment up to now, with times relative to it."""
        found: dict[float, dict[str, Number]] = {}
        for name, series in self._series.items():
            for at_s, value in self._window(series, moment_s - before_s):
                found.setdefault(round(at_s - moment_s, 3), {})[name] = series.shown(value)
        return table_of(sorted(found.items()))

    @staticmethod
    def _window(series: _PointReadings, since_s: float) -> Iterator[tuple[float, float]]:
        """Give the readings since a moment; a value that stood before it begins there."""
        last: tuple[float, float] | None = None
        for at_s, value in zip(series.times, series.values, strict=True):
            if at_s < since_s:
                last = (at_s, value)
                continue
            if last is not None and last[1] == value:
                yield since_s, value
            last = None
            yield at_s, value


def table_of(moments: list[tuple[float, dict[str, Number]]]) -> ReadingTable:
    """Return the table of some moments in order of time; a point that never changed is a constant."""
    names = sorted({name for _, values in moments for name in values})
    seen = {name: {values[name] for _, values in moments if name in values} for name in names}
    constant = {name: values.pop() for name, values in seen.items() if len(values) == 1}
    varying = [name for name in names if name not in constant]
    shown = [(t_s, values) for t_s, values in moments if not values.keys().isdisjoint(varying)]
    if not shown and moments:
        shown = [moments[0], moments[-1]] if len(moments) > 1 else moments
    columns = {name: tuple(values.get(name) for _, values in shown) for name in varying}
    return ReadingTable(tuple(t_s for t_s, _ in shown), columns, constant)


def without(table: ReadingTable, rows: set[int]) -> ReadingTable:
    """Return a table with some of its moments left out."""
    left = [row for row in range(len(table.t_s)) if row not in rows]
    columns = {name: tuple(column[row] for row in left) for name, column in table.points.items()}
    return ReadingTable(tuple(table.t_s[row] for row in left), columns, table.constant)
