"""A queue as one would write it first: a list in no order, looked through at every call."""

from __future__ import annotations

from math import inf

from gateway.line.scheduler.line_time import EdfQueue, T


class ListQueue(EdfQueue[T]):
    """Does what `EdfQueue` does."""

    def put(self, thing: T, release_s: float, deadline_s: float) -> None:
        thing.leave()
        thing.queue, thing.release_s, thing.deadline_s = self, release_s, deadline_s
        self.things.append(thing)

    def first(self, now_s: float) -> T | None:
        released = [each for each in self.things if each.release_s <= now_s]
        return min(released, key=lambda each: each.deadline_s, default=None)

    def next_s(self) -> float:
        return min((each.release_s for each in self.things), default=inf)
