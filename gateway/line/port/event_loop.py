"""A selector for the lines' loop: exact waits, and it knows how late the loop is.

select() takes its timeout in microseconds where epoll takes whole milliseconds.
"""

from __future__ import annotations

import asyncio
import math
import select
import selectors
import time
from collections.abc import Callable
from typing import Any

DESCRIPTOR_LIMIT = 1024  # FD_SETSIZE

NoteDelay = Callable[[float, float], None]  # so many seconds too late, and when that was


class PreciseSelector(selectors.SelectSelector):
    """A SelectSelector for a loop that has its thread to itself."""

    def __init__(self, note_delay: NoteDelay | None = None) -> None:
        super().__init__()
        self._note_delay = note_delay
        self._read_only: dict[int, selectors.SelectorKey] = {}
        self._others = 0  # files of which more than their reading is watched
        self._first: dict[int, Callable[[], None]] = {}  # by descriptor: what is done before all else
        self._returned_s = math.inf

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """Watch a file; ValueError for a descriptor that select() cannot watch."""
        number = fileobj if isinstance(fileobj, int) else fileobj.fileno()
        if number >= DESCRIPTOR_LIMIT:
            raise ValueError(f"descriptor {number} is not below {DESCRIPTOR_LIMIT}: too many open files")
        key = super().register(fileobj, events, data)
        if events == selectors.EVENT_READ:
            self._read_only[key.fd] = key
        else:
            self._others += 1
        return key

    def do_first(self, number: int, call: Callable[[], None]) -> None:
        """Have something done the moment a watched descriptor can be read, before the loop hears of it."""
        self._first[number] = call

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        """Watch a file no more."""
        key = super().unregister(fileobj)
        self._first.pop(key.fd, None)
        if self._read_only.pop(key.fd, None) is None:
            self._others -= 1
        return key

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return what is ready, as every selector does."""
        asked_s = time.monotonic()
        if self._others:
            ready = super().select(timeout)
        else:  # the usual case in less time: no file waits to be written
            waits_s = None if timeout is None else max(timeout, 0.0)
            ready = []
            for number in select.select(self._read_only, (), (), waits_s)[0]:
                ready.append((self._read_only[number], selectors.EVENT_READ))
                if number in self._first:
                    self._first[number]()
        now_s = time.monotonic()
        if self._note_delay is not None:
            late_s = 0.0 if timeout is None or ready else now_s - asked_s - max(timeout, 0.0)
            self._note_delay(max(asked_s - self._returned_s, late_s, 0.0), now_s)
        self._returned_s = now_s
        return ready


class PreciseLoop(asyncio.SelectorEventLoop):
    """A loop on a PreciseSelector."""

    time = staticmethod(time.monotonic)  # what asyncio's method returns, some twenty times a transaction

    def __init__(self, note_delay: NoteDelay | None = None) -> None:
        self._precise = PreciseSelector(note_delay)
        super().__init__(self._precise)

    def add_quick_reader(self, number: int, take: Callable[[], None], tell: Callable[[], None]) -> None:
        """Call `take` the moment a descriptor can be read, and `tell` in the loop's turn after that."""
        self.add_reader(number, tell)
        self._precise.do_first(number, take)


def new_precise_loop(note_delay: NoteDelay | None = None) -> PreciseLoop:
    """Return an event loop with exact timers for the calling thread.

    `note_delay` is told after each wait how long what ran before it took, or how late it ended.
    """
    return PreciseLoop(note_delay)
