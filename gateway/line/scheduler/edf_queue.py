"""Earliest deadline first among the things whose release time has come.

Two heaps with lazy deletion: putting a thing again leaves a stale record behind; a call costs O(log n).
"""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass
from math import inf
from typing import Generic, TypeVar

_SPARE_RECORDS = 64  # stale ones that are not worth a clean-up
_places = itertools.count(1)


@dataclass(slots=True, eq=False, kw_only=True)
class Queued:
    """A thing that can wait in one queue at a time."""

    release_s: float = inf  # not before
    deadline_s: float = inf
    place: int = 0  # its valid record, 0 for none; among equals the lower is served first

    def leave(self) -> None:
        """Leave the queue; nothing when it waits in none."""
        self.place = 0


T = TypeVar("T", bound=Queued)


class EdfQueue(Generic[T]):
    """Things by release and deadline; a thing leaves by `leave`, or when it is put into another."""

    def __init__(self) -> None:
        self._waiting: list[tuple[float, int, T]] = []
        self._ready: list[tuple[float, int, T]] = []
        self._clean_at = _SPARE_RECORDS

    def put(self, thing: T) -> None:
        """Queue a thing by its release and deadline; it leaves the queue it was in."""
        thing.place = next(_places)
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
        while ready and ready[0][2].place != ready[0][1]:
            heapq.heappop(ready)
        return ready[0][2] if ready else None

    def next_s(self) -> float:
        """Return the release of what `first` returns next; never later than that."""
        for heap in (self._ready, self._waiting):
            while heap and heap[0][2].place != heap[0][1]:
                heapq.heappop(heap)
            if heap:
                return heap[0][2].release_s
        return inf

    def _clean(self) -> None:
        """Drop the stale records, so that putting a thing often costs no memory."""
        for heap in (self._waiting, self._ready):
            heap[:] = [record for record in heap if record[2].place == record[1]]
            heapq.heapify(heap)
        self._clean_at = 2 * (len(self._waiting) + len(self._ready)) + _SPARE_RECORDS
