"""An agenda as one would write it first: a plain list, looked through at every call."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Generic, TypeVar

from gateway.line.scheduler.edf_queue import Listed

T = TypeVar("T", bound=Listed)


class ListAgenda(Generic[T]):
    """Does what `Agenda` does."""

    def __init__(self, places: Iterator[int]) -> None:
        self._places = places
        self._things: list[tuple[int, T]] = []
        self._ready: set[int] = set()  # places that a `first` has seen released

    def put(self, thing: T) -> None:
        thing.place = next(self._places)
        self._things.append((thing.place, thing))

    def first(self, now_s: float) -> T | None:
        self._ready |= {place for place, thing in self._valid() if thing.release_s <= now_s}
        return self.released()

    def released(self) -> T | None:
        ready = [(each.deadline_s, place, each) for place, each in self._valid() if place in self._ready]
        return min(ready)[2] if ready else None

    def upcoming(self) -> T | None:
        later = [(each.release_s, place, each) for place, each in self._valid() if place not in self._ready]
        return min(later)[2] if later else None

    def _valid(self) -> list[tuple[int, T]]:
        self._things = [(place, thing) for place, thing in self._things if thing.place == place]
        return self._things
