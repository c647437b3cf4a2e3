"""A future whose task goes on the moment it is woken, not in the loop's next turn."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator
from contextvars import Context
from typing import Any


class Wakeup:
    """What one task waits for, once; speaks asyncio's protocol for things that a task may await.

    An `asyncio.Future` tells its task through the loop: one more turn, one more handle, some 50 us of
    processor time that a line has to spend several times for each request.
    """

    _asyncio_future_blocking = False

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._is_done = self._is_cancelled = False
        self._call: Callable[[Any], object] | None = None
        self._context: Context | None = None

    def __await__(self) -> Generator[Wakeup]:
        """Wait until woken."""
        if not self._is_done:
            self._asyncio_future_blocking = True
            yield self
        self.result()

    def wake(self) -> None:
        """Let the task go on, at once unless another one is running; only the first call does anything."""
        if self._is_done:
            return
        self._is_done = True
        if self._call is None or self._context is None:
            return
        if asyncio.current_task(self._loop) is None:
            self._context.run(self._call, self)
        else:
            self._loop.call_soon(self._call, self, context=self._context)

    def done(self) -> bool:
        """Return whether it was woken or cancelled."""
        return self._is_done

    def result(self) -> None:
        """Return nothing; raise CancelledError when it was cancelled."""
        if self._is_cancelled:
            raise asyncio.CancelledError

    def cancel(self, msg: Any = None) -> bool:  # noqa: ARG002 - a future's shape
        """Wake the task with a cancellation; asyncio calls this."""
        if self._is_done:
            return False
        self._is_done = self._is_cancelled = True
        if self._call is not None:
            self._loop.call_soon(self._call, self, context=self._context)
        return True

    def add_done_callback(self, call: Callable[[Any], object], *, context: Context) -> None:
        """Take what lets the task go on; asyncio calls this."""
        self._call, self._context = call, context

    def get_loop(self) -> asyncio.AbstractEventLoop:
        """Return the loop; asyncio compares it with the task's."""
        return self._loop
