"""Admits the commands of one line a few at a time, so that those which are served are served in time.

On a full line all of them at once would finish reading when all have expired. A command frees its slot
once its first write is done; its read-backs need none. How long a slot is held is learnt from those before.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from math import inf

from gateway.errors import CommandError

AT_ONCE = 4  # while one waits for the disk, others use the line
LINE_FULL = "line_full"
_SMOOTHING = 0.3  # the share of the latest slot in what is learnt


class CommandQueue:
    """First come, first served."""

    def __init__(self, now_s: Callable[[], float]) -> None:
        self.now_s = now_s
        self._served = 0
        self._waiting: list[Place] = []
        self._slot_s: float | None = None

    def wait_s(self, ahead: int | None = None) -> float:
        """Return after what time one more is expected to have written, with so many (or all) ahead of it.

        No time where a slot is free: what was learnt in a rush says nothing about a calm line.
        """
        ahead = len(self._waiting) if ahead is None else ahead
        if ahead + self._served < AT_ONCE:
            return 0.0
        rounds = 1 + (ahead + self._served) / AT_ONCE
        return rounds * (self._slot_s or 0.0)

    def refusal(self, wait_s: float) -> CommandError:
        """Return why a command cannot be served in time."""
        text = f"the line is full: the command could go out in {wait_s:.1f} s, when it has expired"
        return CommandError(LINE_FULL, f"{text}; send it again then")

    def enter(self, expires_s: float | None) -> Place:
        """Return the place of one more command, which is not to be written later than this."""
        return Place(self, inf if expires_s is None else expires_s)

    def serve(self) -> None:
        """Serve the next places; refuse those that would be served too late."""
        while self._waiting and self._served < AT_ONCE:
            self._served += 1
            self._waiting.pop(0).begin()
        for ahead, place in enumerate(tuple(self._waiting)):
            wait_s = self.wait_s(ahead)
            if self.now_s() + wait_s > place.expires_s:
                self._waiting.remove(place)
                place.refuse(self.refusal(wait_s))

    def wait_at(self, place: Place) -> None:
        """Put a place at the end."""
        self._waiting.append(place)
        self.serve()

    def leave(self, place: Place, took_s: float | None) -> None:
        """Remove a place that was served for `took_s`; None: it never was."""
        if place in self._waiting:
            self._waiting.remove(place)
        if took_s is None:
            return
        self._served -= 1
        self._slot_s = took_s if self._slot_s is None else self._slot_s + _SMOOTHING * (took_s - self._slot_s)
        self.serve()


class Place:
    """One command's place in the queue of its line."""

    def __init__(self, queue: CommandQueue, expires_s: float) -> None:
        self.expires_s = expires_s
        self._queue = queue
        self._slot: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._since_s: float | None = None
        self._is_left = False

    async def wait(self) -> None:
        """Wait until it is served; CommandError when that would be too late."""
        began_s = self._queue.now_s()
        self._queue.wait_at(self)
        left_s = self.expires_s - began_s
        timer = asyncio.get_running_loop().call_later(left_s, self._expire) if left_s < inf else None
        try:
            await self._slot
        finally:
            if timer is not None:
                timer.cancel()

    def begin(self) -> None:
        """Serve it from now on."""
        self._since_s = self._queue.now_s()
        if not self._slot.done():
            self._slot.set_result(None)

    def refuse(self, error: CommandError) -> None:
        """End the wait: it would be served too late."""
        if not self._slot.done():
            self._slot.set_exception(error)

    def leave(self) -> None:
        """Free its slot for the next one; may be called again."""
        if not self._is_left:
            self._is_left = True
            self._queue.leave(self, None if self._since_s is None else self._queue.now_s() - self._since_s)

    def _expire(self) -> None:
        self._queue.leave(self, None)
        self.refuse(self._queue.refusal(self._queue.wait_s()))
