"""What is due next of many things: the earliest deadline among those whose time has come.

Two heaps with lazy deletion: what is put anew only leaves a stale record behind, so every call costs
O(log n), however many things there are.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from typing import Generic, TypeVar

NOWHERE = 0

_SPARE_RECORDS = 64  # stale ones that are not worth a clean-up


@dataclass(slots=True, eq=False, kw_only=True)
class Listed:
    """One thing that can stand on an agenda, on one at a time."""

    release_s: float = inf  # not before
    deadline_s: float = inf
    place: int = NOWHERE  # among equals the lower is served first


T = TypeVar("T", bound=Listed)


class EdfQueue(Generic[T]):
    """Things by release and deadline; `places` numbers those of all agendas that share things."""

    def __init__(self, places: Iterator[int]) -> None:
        self._places = places
        self._waiting: list[tuple[float, int, T]] = []
        self._ready: list[tuple[float, int, T]] = []
        self._clean_at = _SPARE_RECORDS

    def put(self, thing: T) -> None:
        """Take a thing with its release and deadline; it leaves the agenda that it was on."""
        thing.place = next(self._places)
        heapq.heappush(self._waiting, (thing.release_s, thing.place, thing))
        if len(self._waiting) + len(self._ready) > self._clean_at:
            self._clean()

    def first(self, now_s: float) -> T | None:
        """Return the released thing with the earliest deadline; it stays."""
        waiting, ready = self._waiting, self._ready
        while waiting and waiting[0][0] <= now_s:
            _, place, thing = heapq.heappop(waiting)
            if thing.place == place:
                heapq.heappush(ready, (thing.deadline_s, place, thing))
        return _head(ready)

    def released(self) -> T | None:
        """Return what the latest `first` would return if it were called again."""
        return _head(self._ready)

    def upcoming(self) -> T | None:
        """Return what is released next of what the latest `first` did not see released."""
        return _head(self._waiting)

    def _clean(self) -> None:
        """Drop the stale records, so that changing one's mind often costs no memory."""
        for heap in (self._waiting, self._ready):
            heap[:] = [record for record in heap if record[2].place == record[1]]
            heapq.heapify(heap)
        self._clean_at = 2 * (len(self._waiting) + len(self._ready)) + _SPARE_RECORDS


def _head(heap: list[tuple[float, int, T]]) -> T | None:
    while heap and heap[0][2].place != heap[0][1]:
        heapq.heappop(heap)
    return heap[0][2] if heap else None
