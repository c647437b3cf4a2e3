"""A queue as one would write it first: a plain list, looked through at every call."""

from __future__ import annotations

import itertools
from math import inf
from typing import Generic, TypeVar

from gateway.line.scheduler.edf_queue import Queued

T = TypeVar("T", bound=Queued)

_places = itertools.count(1)


class ListQueue(Generic[T]):
    """Does what `EdfQueue` does."""

    def __init__(self) -> None:
        self._things: list[tuple[int, float, float, T]] = []
        self._released: set[int] = set()  # places that a `first` has seen released

    def put(self, thing: T) -> None:
        thing.place = next(_places)
        self._things.append((thing.place, thing.release_s, thing.deadline_s, thing))

    def first(self, now_s: float) -> T | None:
        self._released |= {place for place, release_s, _, _ in self._valid() if release_s <= now_s}
        return self._head()

    def next_s(self) -> float:
        thing = self._head()
        if thing is None:
            waiting = [each for each in self._valid() if each[0] not in self._released]
            thing = min(waiting, key=lambda each: (each[1], each[0]))[3] if waiting else None
        return inf if thing is None else thing.release_s

    def _head(self) -> T | None:
        released = [each for each in self._valid() if each[0] in self._released]
        return min(released, key=lambda each: (each[2], each[0]))[3] if released else None

    def _valid(self) -> list[tuple[int, float, float, T]]:
        self._things = [each for each in self._things if each[3].place == each[0]]
        return self._things
