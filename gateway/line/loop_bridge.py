"""Carries what the lines tell from their loop to the app's, in order, many calls at a time."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable

from gateway.line.events import LineListener
from gateway.line.rtu.outcome import Outcome

SOON_S = 0.1  # for answers to polls on their way to the app's loop


class LoopBridge:
    """Carries calls from the lines' loop to the app's, in order, many at a time."""

    def __init__(self) -> None:
        self.loop: asyncio.AbstractEventLoop | None = None
        self._calls: deque[Callable[[], object]] = deque()
        self._is_posted = False
        self._timer: asyncio.TimerHandle | None = None

    def post(self, call: Callable[[], object]) -> None:
        """Have a call done now, after those that wait."""
        self._calls.append(call)
        self.flush()

    def post_soon(self, call: Callable[[], object]) -> None:
        """Have a call done within a moment: to wake the app's loop for each would cost more than the call."""
        self._calls.append(call)
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(SOON_S, self.flush)

    def flush(self) -> None:
        """Have done now what waits."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._calls and not self._is_posted and self.loop is not None:
            self._is_posted = True
            with contextlib.suppress(RuntimeError):  # the app's loop is closed: nobody is left to tell
                self.loop.call_soon_threadsafe(self._deliver)

    def _deliver(self) -> None:
        self._is_posted = False  # first, so that a call that comes from now on is posted anew
        try:
            while self._calls:
                self._calls.popleft()()
        finally:
            if self._calls and self.loop is not None:  # one of them raised; the rest must not wait for more
                self.loop.call_soon(self._deliver)


class CarriedListener:
    """Hands every call on to the app's loop, until it is muted there: then also none that is under way."""

    def __init__(self, listener: LineListener, courier: LoopBridge) -> None:
        self._listener = listener
        self._courier = courier
        self._is_muted = False  # belongs to the app's loop

    def mute(self) -> None:
        """Hand nothing on any more; called on the app's loop."""
        self._is_muted = True

    def on_poll(self, line: str, key: str, unit: int, outcome: Outcome) -> None:
        """Hand it on, with other answers."""
        self._courier.post_soon(self._carried(lambda: self._listener.on_poll(line, key, unit, outcome)))

    def on_unit(self, line: str, unit: int, is_answering: bool, reason: str, frames: tuple[str, ...]) -> None:  # noqa: FBT001 - as in LineListener
        """Hand it on."""
        call = self._carried(lambda: self._listener.on_unit(line, unit, is_answering, reason, frames))
        self._courier.post(call)

    def on_trouble(self, line: str, code: str, unit: int, text: str, frames: tuple[str, ...]) -> None:
        """Hand it on."""
        call = self._carried(lambda: self._listener.on_trouble(line, code, unit, text, frames))
        self._courier.post(call)

    def on_port(self, line: str, is_open: bool, reason: str) -> None:  # noqa: FBT001 - as in LineListener
        """Hand it on."""
        self._courier.post(self._carried(lambda: self._listener.on_port(line, is_open, reason)))

    def _carried(self, call: Callable[[], None]) -> Callable[[], None]:
        return lambda: None if self._is_muted else call()
