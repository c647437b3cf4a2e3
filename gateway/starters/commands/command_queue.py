"""The commands of one line decide and write in turn, so that those which have their turn have it in time.

On a full line all of them at once would finish reading when all have expired. A command leaves when its first
write is done; its read-backs need no turn. How long a turn takes is learnt from those before.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from math import inf

from gateway.errors import CommandError

AT_ONCE = 4  # while one waits for the disk, others use the line
LINE_FULL = "line_full"
_SMOOTHING = 0.3  # the share of the latest turn in what is learnt


class CommandQueue:
    """First come, first served."""

    def __init__(self, now_s: Callable[[], float]) -> None:
        self.now_s = now_s
        self._served = 0
        self._waiting: list[Place] = []
        self._turn_s: float | None = None

    def wait_s(self, ahead: int | None = None) -> float:
        """Return after what time one more is expected to have written, with so many (or all) ahead of it.

        No time where a turn is free: what was learnt in a rush says nothing about a calm line.
        """
        ahead = len(self._waiting) if ahead is None else ahead
        if ahead + self._served < AT_ONCE:
            return 0.0
        rounds = 1 + (ahead + self._served) / AT_ONCE
        return rounds * (self._turn_s or 0.0)

    def refusal(self, wait_s: float) -> CommandError:
        """Return why a command cannot have its turn in time."""
        text = f"the line is full: its turn is expected in {wait_s:.1f} s, when the command has expired"
        return CommandError(LINE_FULL, f"{text}; send it again then")

    def enter(self, expires_s: float | None) -> Place:
        """Return the place of one more command, which is not to be written later than this."""
        return Place(self, inf if expires_s is None else expires_s)

    def serve(self) -> None:
        """Give the next places their turn; refuse those whose turn would come too late."""
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
        """Let a place go, which had its turn for so long; None: it never had."""
        if place in self._waiting:
            self._waiting.remove(place)
        if took_s is None:
            return
        self._served -= 1
        self._turn_s = took_s if self._turn_s is None else self._turn_s + _SMOOTHING * (took_s - self._turn_s)
        self.serve()


class Place:
    """One command's place in the queue of its line."""

    def __init__(self, queue: CommandQueue, expires_s: float) -> None:
        self.expires_s = expires_s
        self._queue = queue
        self._turn: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._since_s: float | None = None
        self._is_left = False

    async def wait(self) -> None:
        """Wait for the turn; CommandError when it does not come in time."""
        began_s = self._queue.now_s()
        self._queue.wait_at(self)
        left_s = self.expires_s - began_s
        timer = asyncio.get_running_loop().call_later(left_s, self._expire) if left_s < inf else None
        try:
            await self._turn
        finally:
            if timer is not None:
                timer.cancel()

    def begin(self) -> None:
        """Take note that it has its turn."""
        self._since_s = self._queue.now_s()
        if not self._turn.done():
            self._turn.set_result(None)

    def refuse(self, error: CommandError) -> None:
        """End the wait: the turn would come too late."""
        if not self._turn.done():
            self._turn.set_exception(error)

    def leave(self) -> None:
        """Let the next one have its turn; may be called again."""
        if not self._is_left:
            self._is_left = True
            self._queue.leave(self, None if self._since_s is None else self._queue.now_s() - self._since_s)

    def _expire(self) -> None:
        self._queue.leave(self, None)
        self.refuse(self._queue.refusal(self._queue.wait_s()))
