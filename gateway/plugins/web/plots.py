"""Current and voltage of each starter over time, in rings of fixed size; pure.

A value is published when it changes, so the last good one fills the slots until the next one comes. What is
not good is NaN.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence

SPARK_STEP_S, SPARK_SLOTS = 2.0, 300  # 10 minutes
HOUR_STEP_S, HOUR_SLOTS = 10.0, 360

NAN = math.nan


class Ring:
    """The last `slots` steps of one quantity; of several values in a step the largest, or the last."""

    __slots__ = ("_held", "_is_peak", "_slot", "_step_s", "_values")

    def __init__(self, step_s: float, slots: int, *, is_peak: bool) -> None:
        self._values = array("f", [NAN]) * slots
        self._step_s = step_s
        self._is_peak = is_peak
        self._slot: int | None = None  # of the newest value
        self._held = NAN

    def put(self, value: float, now_s: float) -> None:
        """Record a value; NaN where it is not known from now on."""
        self._advance(now_s)
        index = self._index
        known = self._values[index]
        is_higher = self._is_peak and not math.isnan(known) and not math.isnan(value) and known > value
        if not is_higher:
            self._values[index] = value
        self._held = value

    def values(self, now_s: float) -> list[float]:
        """Return the slots up to now, the oldest first."""
        if self._slot is None:
            return [NAN] * len(self._values)
        self._advance(now_s)
        first = self._index + 1
        return [*self._values[first:], *self._values[:first]]

    @property
    def _index(self) -> int:
        return (self._slot or 0) % len(self._values)

    def _advance(self, now_s: float) -> None:
        slot = int(now_s // self._step_s)
        if self._slot is None:
            self._slot = slot
            return
        for each in range(max(self._slot, slot - len(self._values)) + 1, slot + 1):
            self._values[each % len(self._values)] = self._held
        self._slot = max(self._slot, slot)


class StarterPlots:
    """One starter's rings; about 4 KB."""

    __slots__ = ("current", "spark", "voltage")

    def __init__(self) -> None:
        self.spark = Ring(SPARK_STEP_S, SPARK_SLOTS, is_peak=True)
        self.current = Ring(HOUR_STEP_S, HOUR_SLOTS, is_peak=True)
        self.voltage = Ring(HOUR_STEP_S, HOUR_SLOTS, is_peak=False)

    def put_current(self, value: float, now_s: float) -> None:
        """Record a current."""
        self.spark.put(value, now_s)
        self.current.put(value, now_s)


def numbers(values: Sequence[float]) -> list[float | None]:
    """Return values for JSON, with a tenth of a unit as the smallest step."""
    return [None if math.isnan(value) else round(value, 1) for value in values]


def thinned(values: Sequence[float], points: int) -> list[float]:
    """Return at most so many values: the largest of each run of neighbours."""
    size = -(-len(values) // max(1, points))
    runs = (values[at : at + size] for at in range(0, len(values), size))
    return [max((value for value in run if not math.isnan(value)), default=NAN) for run in runs]
