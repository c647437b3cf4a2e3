"""The last readings of one starter, at least a minute of them, from which the record of a trip is made.

Each point has a list of times and one of values. A value that does not change has two entries, the first and
the latest reading of it. A point with `MOST` entries gives up every other one of its older half: near the
present nothing is missing, and at four readings a second a minute is there. A point that is read seldom
gives up what is older than `LASTS_S`, `FEW` entries at a time. Times are on the steady clock.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from gateway.contract import ReadingTable

BEFORE_S = 60.0  # what a table shows of the time before its moment
MOST = 240  # readings of one point: four a second for a minute
FEW = 16
# So much is there of the time before a trip, whose table is asked for up to 15 s after it, or some readings.
LASTS_S = BEFORE_S + 30.0

Number = bool | int | float
Moment = tuple[float, Mapping[str, Number]]


class _PointReadings:
    """The readings of one point."""

    __slots__ = ("times", "values")

    def __init__(self) -> None:
        self.times = array("d")
        self.values: list[Number] = []

    def add(self, at_s: float, value: Number) -> None:
        if self.times and at_s <= self.times[-1]:
            return
        if self.values[-2:] == [value, value]:
            self.times[-1] = at_s
            return
        self.times.append(at_s)
        self.values.append(value)
        if len(self.times) >= MOST:
            del self.times[1 : MOST // 2 : 2]
            del self.values[1 : MOST // 2 : 2]
        elif len(self.times) > 2 * FEW and self.times[FEW] < at_s - LASTS_S:
            del self.times[:FEW]
            del self.values[:FEW]

    def since(self, since_s: float) -> list[tuple[float, Number]]:
        """Return the readings since a moment; a value that was the same before it begins there."""
        first = bisect_left(self.times, since_s)
        found = list(zip(self.times[first:], self.values[first:], strict=True))
        if first and found and self.values[first - 1] == self.values[first]:
            found.insert(0, (since_s, self.values[first]))
        return found


class ReadingRing:
    """The readings of one starter that are numbers or flags."""

    def __init__(self) -> None:
        self._points: defaultdict[str, _PointReadings] = defaultdict(_PointReadings)

    def note(self, values: Mapping[str, Any], *, at_s: float) -> None:
        """Add good readings, all of one moment; one that is older than the point's last is ignored."""
        for name, value in values.items():
            if isinstance(value, (bool, int, float)):
                self._points[name].add(at_s, value)

    def began_s(self, flag: str) -> float | None:
        """Return when a flag that is on now was read as on for the first time; None when it is off."""
        began_s, known = None, self._points[flag]
        for at_s, value in zip(reversed(known.times), reversed(known.values), strict=True):
            if not value:
                break
            began_s = at_s
        return began_s

    def around(self, moment_s: float, *, before_s: float = BEFORE_S) -> ReadingTable:
        """Return the readings from `before_s` before a moment up to now, with times relative to it."""
        found: defaultdict[float, dict[str, Number]] = defaultdict(dict)
        for name, known in self._points.items():
            for at_s, value in known.since(moment_s - before_s):
                found[round(at_s - moment_s, 3)][name] = value
        return table_of(sorted(found.items()))


def table_of(moments: Sequence[Moment]) -> ReadingTable:
    """Return the table of some moments in order of time; a point that never changed is a constant."""
    names = sorted({name for _, values in moments for name in values})
    seen = {name: {values[name] for _, values in moments if name in values} for name in names}
    constant = {name: values.pop() for name, values in seen.items() if len(values) == 1}
    varying = [name for name in names if name not in constant]
    shown = [(t_s, values) for t_s, values in moments if not values.keys().isdisjoint(varying)]
    shown = shown or [*moments[:1], *moments[1:][-1:]]
    columns = {name: tuple(values.get(name) for _, values in shown) for name in varying}
    return ReadingTable(tuple(t_s for t_s, _ in shown), columns, constant)
