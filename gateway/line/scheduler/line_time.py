"""How a line's time is shared out: deadlines, shares, and the factor by which all periods grow."""

from __future__ import annotations

from bisect import insort
from dataclasses import dataclass
from math import inf
from operator import attrgetter
from typing import Any, Generic, TypeVar

JOBS_SHARE = 0.5  # of the line's time while polls are due, for all jobs but stops
JOBS_BURST_S = 0.25  # of line time may be saved up: about what a start with its read-backs needs
FREE_PERIOD_S = 5.0  # the period of a poll with `every_s` 0; it comes earlier whenever the line is free


by_deadline = attrgetter("deadline_s")
_release_s = attrgetter("release_s")


@dataclass(slots=True, eq=False, kw_only=True)
class Queued:
    """A thing that can wait in one queue at a time."""

    release_s: float = inf  # not before
    deadline_s: float = inf
    queue: EdfQueue[Any] | None = None  # where it waits

    def leave(self) -> None:
        """Leave the queue; nothing when it waits in none."""
        if self.queue is not None:
            self.queue.things.remove(self)
            self.queue = None


T = TypeVar("T", bound=Queued)


class EdfQueue(Generic[T]):
    """Earliest deadline first among the things that are released; a thing may move to another queue."""

    def __init__(self) -> None:
        self.things: list[T] = []  # by deadline, equal ones as they were put
        self.released_s = inf  # none of them before

    def put(self, thing: T, release_s: float, deadline_s: float) -> None:
        """Queue a thing; it leaves the queue it was in."""
        if thing.queue is not None:
            thing.leave()
        thing.queue, thing.release_s, thing.deadline_s = self, release_s, deadline_s
        insort(self.things, thing, key=by_deadline)
        self.released_s = min(self.released_s, release_s)

    def first(self, now_s: float) -> T | None:
        """Return the released thing with the earliest deadline; it stays."""
        if now_s >= self.released_s:
            for thing in self.things:
                if thing.release_s <= now_s:
                    return thing
            self.next_s()
        return None

    def next_s(self) -> float:
        """Return when the first of the things is released."""
        self.released_s = min(map(_release_s, self.things), default=inf)
        return self.released_s


class LineTimeBudget:
    """A token bucket that a share of the time fills up to `burst_s`; begins full, owes `burst_s` at most."""

    def __init__(self, share: float, burst_s: float) -> None:
        self.room_at_s = -inf  # from then on something may be sent, which may overdraw it once; -inf: full
        self._share = share
        self._fills_in_s = burst_s / share

    def spend(self, took_s: float, now_s: float) -> None:
        """Take out what was used of the line until now."""
        room_at_s = max(self.room_at_s, now_s - self._fills_in_s) + took_s / self._share
        self.room_at_s = min(room_at_s, now_s + self._fills_in_s)


def overload_factor(load: float, *, others: float = 0.0) -> float:
    """Return the factor for a load, when others take their share first, half of the line's time at most."""
    return max(1.0, load / (1.0 - min(others, JOBS_SHARE)))
