"""What became of the requests to each starter, over sliding windows; and how sure a share of them is.

Three ways for a reply to be missing are distinguished: *corrupted* (octets that are no frame: bad CRC, cut
short), *lost* (nothing came) and *late* (the right reply came after its time).
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Mapping
from math import sqrt
from typing import Any, NamedTuple

CONFIDENCE = 2.576  # standard deviations: 99 % of a normal distribution, both sides
ENOUGH = 300  # requests: the shortest window that has them decides
LATELY_S, HOUR_S, DAY_S = 600.0, 3600.0, 86400.0
_FINE_S, _COARSE_S = 60.0, 1800.0  # between two sums that are stored, of the last hour and before that


class Counts(NamedTuple):
    """Requests to a starter that answers, and what became of those without a good reply."""

    asked: int = 0
    corrupted: int = 0
    lost: int = 0
    late: int = 0

    def plus(self, other: Counts, sign: int = 1) -> Counts:
        """Return the sum; with sign -1 the difference."""
        return Counts(
            self.asked + sign * other.asked,
            self.corrupted + sign * other.corrupted,
            self.lost + sign * other.lost,
            self.late + sign * other.late,
        )

    @property
    def bad(self) -> int:
        """Replies that were corrupted or lost: both are what a cable does."""
        return self.corrupted + self.lost


def bounds(count: int, of: int) -> tuple[float, float]:
    """Return between what the share `count / of` lies with 99 % confidence (Wilson score interval)."""
    if of <= 0:
        return 0.0, 1.0
    square, share = CONFIDENCE * CONFIDENCE, count / of
    middle = (share + square / (2 * of)) / (1 + square / of)
    half = CONFIDENCE / (1 + square / of) * sqrt(share * (1 - share) / of + square / (4 * of * of))
    return max(middle - half, 0.0), min(middle + half, 1.0)


class StarterCounts:
    """One starter's sums of the last day; while it does not answer at all nothing is added."""

    def __init__(self) -> None:
        self._sum = Counts()
        self._raw: tuple[int, int, int, int] | None = None  # asked, corrupted, silent, late, as given last
        self._was_answering = False
        self._times = array("d")
        self._stored = tuple(array("q") for _ in Counts._fields)  # the sums at these times, by field
        self.is_offline = False

    def take(self, unit: Mapping[str, Any], now_s: float) -> None:
        """Add what the line has counted of this starter since the last call."""
        raw = (unit["asked"], unit.get("corrupted", 0), unit["silent"], unit.get("late", 0))
        is_answering = unit.get("state") != "silent"
        before, self._raw = self._raw, raw
        if not self._times:
            self._put(now_s)
        if before is not None and is_answering and self._was_answering and raw[0] >= before[0]:
            asked, corrupted, silent, late = (new - old for new, old in zip(raw, before, strict=True))
            self._sum = self._sum.plus(Counts(asked, corrupted, max(silent - late, 0), max(late, 0)))
        self._was_answering = is_answering
        self.is_offline = not is_answering
        self._store(now_s)

    def since(self, span_s: float, now_s: float) -> Counts:
        """Return what was counted in this time up to now; over less where less is known."""
        if not self._times:
            return Counts()
        at = max(bisect_right(self._times, now_s - span_s) - 1, 0)
        return self._sum.plus(Counts(*(column[at] for column in self._stored)), -1)

    def _store(self, now_s: float) -> None:
        if now_s - self._times[-1] >= _FINE_S:
            self._put(now_s)
            self._thin(now_s)

    def _put(self, now_s: float) -> None:
        self._times.append(now_s)
        for column, value in zip(self._stored, self._sum, strict=True):
            column.append(value)

    def _thin(self, now_s: float) -> None:
        """Drop what lies closer together than half an hour, an hour after it was stored, and after a day all.

        The latest sum of before that stays: what was counted since then is the day's.
        """
        times = self._times
        first = max(bisect_right(times, now_s - DAY_S) - 1, 0)
        late = bisect_right(times, now_s - HOUR_S - _FINE_S)
        left: list[int] = []
        for at in range(first, late):
            if not left or times[at] - times[left[-1]] >= _COARSE_S:
                left.append(at)
        left += range(max(first, late), len(times))
        if len(left) < len(times):
            self._times = array("d", [times[at] for at in left])
            self._stored = tuple(array("q", [column[at] for at in left]) for column in self._stored)
