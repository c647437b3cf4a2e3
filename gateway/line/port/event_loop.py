"""A selector for the lines' loop: exact waits, alarms without a round of the loop; it knows how late that is.

select() takes its timeout in microseconds where epoll takes whole milliseconds.
"""

from __future__ import annotations

import asyncio
import math
import selectors
import time
from collections.abc import Callable
from typing import Any

DESCRIPTOR_LIMIT = 1024  # FD_SETSIZE
HELD_UP_S = 0.001  # an alarm that is so late waits for one more look at what can be read

NoteDelay = Callable[[float], None]  # so many seconds too late


class PreciseSelector(selectors.SelectSelector):
    """A SelectSelector for a loop that has its thread to itself."""

    def __init__(self, note_delay: NoteDelay | None = None) -> None:
        super().__init__()
        self._note_delay = note_delay
        self._quick: dict[int, Callable[[], None]] = {}  # by descriptor: called here, not by the loop
        self.alarms: dict[Callable[[], None], float] = {}  # what is called here as soon as it is time
        self._returned_s = math.inf

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """Watch a file; ValueError for a descriptor that select() cannot watch."""
        number = fileobj if isinstance(fileobj, int) else fileobj.fileno()
        if number >= DESCRIPTOR_LIMIT:
            raise ValueError(f"descriptor {number} is not below {DESCRIPTOR_LIMIT}: too many open files")
        return super().register(fileobj, events, data)

    def add_quick_reader(self, number: int, call: Callable[[], None]) -> None:
        """Have something called the moment a descriptor can be read, before the loop's next callbacks."""
        self.register(number, selectors.EVENT_READ)
        self._quick[number] = call

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        """Stop watching a file."""
        key = super().unregister(fileobj)
        self._quick.pop(key.fd, None)
        return key

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return what is ready, as every selector does; quick readers and alarms are called."""
        asked_s = time.monotonic()
        alarms = self.alarms
        for due_s in alarms.values():  # one for each line at most
            timeout = due_s - asked_s if timeout is None else min(timeout, due_s - asked_s)
        found = super().select(timeout)
        now_s = time.monotonic()
        if self._note_delay is not None:
            late_s = 0.0 if timeout is None or found else now_s - asked_s - max(timeout, 0.0)
            self._note_delay(max(asked_s - self._returned_s, late_s, 0.0))
        ready = []
        for key, events in found:
            call = self._quick.get(key.fd)
            if call is None:
                ready.append((key, events))
            else:
                call()
        for alarm, due_s in tuple(alarms.items()):
            # Then what came meanwhile is read first.
            is_held_up = now_s - due_s > HELD_UP_S and due_s > asked_s
            if due_s <= now_s and not is_held_up:
                del alarms[alarm]
                alarm()
        self._returned_s = now_s
        return ready


class PreciseLoop(asyncio.SelectorEventLoop):
    """A loop on a PreciseSelector."""

    time = staticmethod(time.monotonic)  # what asyncio's method returns, some twenty times a transaction

    def __init__(self, note_delay: NoteDelay | None = None) -> None:
        self._precise = PreciseSelector(note_delay)
        self.alarms = self._precise.alarms  # by what is to be called: when; what it wakes goes on at once
        super().__init__(self._precise)

    def add_quick_reader(self, number: int, call: Callable[[], None]) -> None:
        """Call `call` the moment a descriptor can be read; what it wakes goes on in the same round."""
        self._precise.add_quick_reader(number, call)

    def remove_quick_reader(self, number: int) -> None:
        """Stop watching a descriptor."""
        self._precise.unregister(number)


def new_precise_loop(note_delay: NoteDelay | None = None) -> PreciseLoop:
    """Return an event loop with exact timers for the calling thread.

    `note_delay` is called after each wait: how long what ran before it took, or how late it ended.
    """
    return PreciseLoop(note_delay)
