"""The samples of a start while it is recorded, and what is computed from them.

Each sample holds what one reply held, at the time of that reply. A start has at most 300 s of them, some
30,000 on the fastest line. A curve that is too long to be shown loses every second sample of each kind of
reply, again and again, but never the highest current.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from operator import itemgetter
from typing import NamedTuple

# The columns of a sample, by key; each is the point of that name, the thermal level that of
# the family's profile.
COLUMNS = ("current", "line_voltage", "output_voltage", "torque_pct", "power_factor", "thermal")
MOST_SHOWN = 300  # in the record: with six columns about 12 KB of JSON
LONGEST_GAP = 0.25  # of the time computed over; more between two samples of the current, and nothing is said
GAP_S = 1.0  # a gap up to this is none
SPIKE = 4.0  # times the higher one of the two readings next to it, and it is no current
HALFWAY = (math.sqrt(5) - 1) / 2  # of a sample: the heat of the line from there to it is 2/3 of its square
MS = 3  # digits of a time and of a value

CURRENT = 0  # its column


class Sums(NamedTuple):
    """Integrals of the current over a time."""

    mean_a: float
    i2t_a2s: float
    spacing_a2s: float  # so much more or less the I2t can be, given how far the samples lie apart
    ends_a2: tuple[float, float]  # the squares of the current at the first and the last sample


class Curve:
    """Samples in the order of their times, on the steady clock; nan where a reply did not hold a quantity."""

    def __init__(self) -> None:
        self.at_s = array("d")
        self._columns = tuple(array("d") for _ in COLUMNS)

    def add(self, at_s: float, values: tuple[float, ...]) -> None:
        """Add a sample: a value for each of `COLUMNS`."""
        self.at_s.append(at_s)
        for column, value in zip(self._columns, values, strict=True):
            column.append(value)

    def cut_before(self, at_s: float) -> None:
        """Drop the samples before this time."""
        first = bisect_left(self.at_s, at_s)
        for column in (self.at_s, *self._columns):
            del column[:first]

    def drop_outliers(self, since_s: float, *, largest_a: float = math.inf) -> int:
        """Drop the currents that no motor has drawn, and return how many they were.

        Those are the ones above the largest that can be, and from the start on each lone one that is `SPIKE`
        times as high as both its neighbours. At its edges nothing is lone: a kick start (one high reading
        after 0) and the current that has tripped the starter are real.
        """
        column = self._columns[CURRENT]
        absurd = [index for index, value in enumerate(column) if value > largest_a]
        for index in absurd:
            column[index] = math.nan
        fed = [n for n, at_s in enumerate(self.at_s) if at_s >= since_s and not math.isnan(column[n])]
        triples = zip(fed, fed[1:], fed[2:], strict=False)
        lone = [now for a, now, b in triples if column[now] > SPIKE * max(column[a], column[b], 0.0)]
        for index in lone:
            column[index] = math.nan
        return len(absurd) + len(lone)

    def currents(self, since_s: float = -math.inf, until_s: float = math.inf) -> list[tuple[float, float]]:
        """Return the time and value of each sample of the current within this time."""
        return list(self._of(CURRENT, since_s, until_s))

    def lowest(self, name: str, since_s: float, until_s: float) -> float | None:
        """Return the lowest value of a quantity within this time; None without one."""
        return min((value for _, value in self._of(COLUMNS.index(name), since_s, until_s)), default=None)

    def latest(self, name: str) -> float | None:
        """Return the newest value of a quantity; None without one."""
        column = self._columns[COLUMNS.index(name)]
        return next((value for value in reversed(column) if value == value), None)

    def sums(self, since_s: float, until_s: float) -> Sums | None:
        """Return mean and I2t of the current by the trapezoidal rule; None when too little was sampled.

        At both ends the current is taken from the line through the two samples next to it; before the first
        sample it has heated at most halfway between a current that has risen evenly from 0 and one that was
        as high as that sample at once.
        """
        course = self._course(since_s, until_s)
        length_s = until_s - since_s
        most_s = max(GAP_S, LONGEST_GAP * length_s)
        pairs = list(pairwise(course))
        if length_s <= 0 or len(pairs) < 2 or any(b[0] - a[0] > most_s for a, b in pairs):
            return None
        charge = sum((b[0] - a[0]) * (a[1] + b[1]) / 2 for a, b in pairs)
        # The square of a straight line, integrated: exact where the current runs straight between samples.
        heat = sum((b[0] - a[0]) * (a[1] * a[1] + a[1] * b[1] + b[1] * b[1]) / 3 for a, b in pairs)
        # A current that only rises or only falls between two samples lies between them.
        spacing = _unseen(*pairs[0]) + sum(
            (b[0] - a[0]) * abs(b[1] * b[1] - a[1] * a[1]) / 2 for a, b in pairs[1:]
        )
        return Sums(charge / length_s, heat, spacing, (course[1][1] ** 2, course[-2][1] ** 2))

    def shown(self, zero_s: float) -> dict[str, tuple[float | None, ...]]:
        """Return the samples as they are stored and published, thinned if there are very many."""
        while len(self.at_s) > MOST_SHOWN:
            self._thin()
        columns = {
            name: tuple(None if math.isnan(value) else round(value, MS) for value in column)
            for name, column in zip(COLUMNS, self._columns, strict=True)
            if not all(map(math.isnan, column))
        }
        return {"t_s": tuple(round(at_s - zero_s, MS) for at_s in self.at_s), **columns}

    def _course(self, since_s: float, until_s: float) -> list[tuple[float, float]]:
        """Return the course of the current over this time, from its first to its last instant."""
        samples = self.currents(since_s)
        inner = [each for each in samples if each[0] < until_s]
        if not inner:
            return []
        after = samples[len(inner)] if len(samples) > len(inner) else None
        first = inner[0]
        following = inner[1] if len(inner) > 1 else after
        begin = HALFWAY * first[1]
        if following is not None:
            begin = min(max(_line(first, following, since_s), 0.0), HALFWAY * first[1])
        end = inner[-1][1] if after is None else _line(inner[-1], after, until_s)
        return [(since_s, begin), *inner, (until_s, end)]

    def _of(self, number: int, since_s: float, until_s: float) -> Iterator[tuple[float, float]]:
        for at_s, value in zip(self.at_s, self._columns[number], strict=True):
            if since_s <= at_s <= until_s and not math.isnan(value):
                yield at_s, value

    def _thin(self) -> None:
        """Drop every second sample of each kind, but not the one with the highest current."""
        seen: Counter[tuple[bool, ...]] = Counter()
        stays: list[int] = []
        peak_s, _ = max(self.currents(), key=itemgetter(1), default=(math.nan, 0.0))
        for index, values in enumerate(zip(*self._columns, strict=True)):
            kind = tuple(map(math.isnan, values))
            seen[kind] += 1
            if seen[kind] % 2 or self.at_s[index] == peak_s:
                stays.append(index)
        for column in (self.at_s, *self._columns):
            column[:] = array("d", [column[index] for index in stays])


def i2t_error_pct_of(sums: Sums, begin_within_s: float, end_within_s: float) -> float | None:
    """Return what the I2t can be wrong by: between samples, and as begin and end lie between replies."""
    if sums.i2t_a2s <= 0:
        return None
    begin_a2, end_a2 = sums.ends_a2
    ends = begin_within_s * begin_a2 + (0.0 if math.isnan(end_within_s) else end_within_s * end_a2)
    return 100 * (sums.spacing_a2s + ends) / sums.i2t_a2s


def _unseen(begin: tuple[float, float], first: tuple[float, float]) -> float:
    """Return by how much the I2t before the first sample can be wrong.

    The current may have been that of the sample at once, or have risen evenly from 0.
    """
    gap_s, begin_a, first_a = first[0] - begin[0], begin[1], first[1]
    taken = (begin_a * begin_a + begin_a * first_a + first_a * first_a) / 3
    return gap_s * max(taken - first_a * first_a / 3, first_a * first_a - taken)


def _line(one: tuple[float, float], other: tuple[float, float], at_s: float) -> float:
    """Return the value at a time on the line through two samples."""
    span_s = other[0] - one[0]
    return one[1] if span_s <= 0 else one[1] + (other[1] - one[1]) * (at_s - one[0]) / span_s
