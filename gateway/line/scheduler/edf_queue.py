"""Earliest deadline first among the things whose release time has come: a list that is sorted by deadline."""

from __future__ import annotations

from bisect import insort
from dataclasses import dataclass
from math import inf
from operator import attrgetter
from typing import Any, Generic, TypeVar

_deadline_s = attrgetter("deadline_s")


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
            self.queue.released_s = -inf
            self.queue = None


T = TypeVar("T", bound=Queued)


class EdfQueue(Generic[T]):
    """Things by release and deadline; a thing leaves by `leave`, or when it is put into another."""

    def __init__(self) -> None:
        self.things: list[T] = []  # by deadline; among equals what was put first is served first
        self.released_s = inf  # when the first of them is released; -inf: to be looked up

    def put(self, thing: T) -> None:
        """Queue a thing by its release and deadline; it leaves the queue it was in."""
        thing.leave()
        thing.queue = self
        insort(self.things, thing, key=_deadline_s)
        self.released_s = min(self.released_s, thing.release_s)

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
        if self.released_s == -inf:
            self.released_s = min([thing.release_s for thing in self.things], default=inf)
        return self.released_s
