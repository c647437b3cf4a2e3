"""What was lost, what was wrong, how long an old value stood as good, by starters' books.

Pure; all times are monotonic seconds.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf

OLD_S = 10.0  # a value may have been read so long before the time that it gives itself
SETTLE_S = 2.0  # a step that has just begun to be published is not lost yet
RATED_A = 85.0
CURRENT, CURRENT_PCT, RUNNING = "current", "current_pct", "running"


@dataclass(frozen=True, slots=True)
class Published:
    """A value as a consumer got it; None: marked as not good, or its teller as away."""

    starter: str
    point: str
    value: float | None
    received_s: float
    time_s: float  # the time that the message itself gives, or when it came
    is_live: bool = True  # not history


@dataclass(frozen=True, slots=True)
class StarterBook:
    """What one starter had: values with the time from which they held, and when it could not be asked."""

    steps: Sequence[tuple[float, float]]
    running: Sequence[tuple[float, float]]
    away: Sequence[tuple[float, float]] = ()
    requests_s: Sequence[float] = ()  # valid requests

    def timeline(self, point: str) -> list[tuple[float, float]]:
        """Return a point's values with the times from which they held."""
        if point == RUNNING:
            return list(self.running)
        if point == CURRENT_PCT:
            return [(at_s, round(100.0 * amps / RATED_A, 1)) for at_s, amps in self.steps]
        return list(self.steps)

    def had(self, point: str, value: float, from_s: float, to_s: float) -> bool:
        """Return whether the starter had this value at any moment between these times."""
        timeline = self.timeline(point)
        first = max(0, bisect_right(timeline, (from_s, inf)) - 1)
        return any(_is_same(each, value) for at_s, each in timeline[first:] if at_s <= to_s)

    def is_away(self, from_s: float, to_s: float) -> bool:
        """Return whether it could not be asked for a part of this time."""
        return any(begin_s < to_s and end_s > from_s for begin_s, end_s in self.away)


def lost(
    books: Mapping[str, StarterBook], published: Sequence[Published], from_s: float, to_s: float
) -> tuple[int, int]:
    """Return how many steps were never published, and of how many that could have been."""
    known = {
        (each.starter, round(each.value, 1))
        for each in published
        if each.point == CURRENT and each.value is not None
    }
    missing = possible = 0
    for name, book in books.items():
        ends_s = [at_s for at_s, _ in book.steps[1:]]
        for (begin_s, amps), end_s in zip(book.steps, ends_s, strict=False):
            if begin_s < from_s or end_s > to_s - SETTLE_S or book.is_away(begin_s, end_s):
                continue
            possible += 1
            missing += (name, round(amps, 1)) not in known
    return missing, possible


def wrong(books: Mapping[str, StarterBook], published: Sequence[Published], from_s: float) -> list[Published]:
    """Return what was published as good since then, but was never so about the time that it gives."""
    return [
        each
        for each in published
        if each.received_s >= from_s
        and each.value is not None
        and not books[each.starter].had(each.point, each.value, each.time_s - OLD_S, each.received_s)
    ]


def longest_stall_s(books: Mapping[str, StarterBook], from_s: float, to_s: float) -> float:
    """Return the longest time without a valid request to any starter that was never dead meanwhile.

    Where the line itself was cut no master could ask; that is the same for everybody, and in this time.
    """
    living = [book for book in books.values() if not book.is_away(from_s, to_s)] or list(books.values())
    return max(
        later - earlier
        for book in living
        for earlier, later in pairwise(
            [from_s, *(at_s for at_s in book.requests_s if from_s < at_s < to_s), to_s]
        )
    )


def longest_old_s(
    books: Mapping[str, StarterBook], published: Sequence[Published], from_s: float, to_s: float
) -> float:
    """Return the longest time for which a current that was no longer so stood as good, of any starter."""
    return max(_longest_old_s(book, _shown(published, name), from_s, to_s) for name, book in books.items())


def _longest_old_s(
    book: StarterBook, shown: Sequence[tuple[float, float | None]], from_s: float, to_s: float
) -> float:
    """Walk through every moment at which something changes."""
    moments = sorted(
        {from_s, to_s}
        | {at_s for at_s, _ in (*book.steps, *shown) if from_s < at_s < to_s}
        | {at_s for pair in book.away for at_s in pair if from_s < at_s < to_s}
    )
    longest_s, since_s = 0.0, None
    for at_s in moments:
        value = _at(shown, at_s)
        is_away = any(begin_s <= at_s < end_s for begin_s, end_s in book.away)
        is_old = value is not None and (is_away or not _is_same(_at(book.steps, at_s), value))
        if since_s is not None:
            longest_s = max(longest_s, at_s - since_s)
        since_s = (since_s if since_s is not None else at_s) if is_old else None
    return longest_s


def _shown(published: Sequence[Published], starter: str) -> list[tuple[float, float | None]]:
    return [
        (each.received_s, each.value)
        for each in published
        if each.starter == starter and each.point == CURRENT and each.is_live
    ]


def _at(timeline: Sequence[tuple[float, float | None]], at_s: float) -> float | None:
    """Return what held at a time; None before all."""
    found = None
    for begin_s, value in timeline:
        if begin_s > at_s:
            break
        found = value
    return found


def _is_same(one: float | None, other: float) -> bool:
    return one is not None and abs(one - other) < 0.01
