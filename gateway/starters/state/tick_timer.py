"""One timer of a starter; all of them run out on ticks, so that the loop wakes up once for many of them."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable

from gateway.starters.state.publication import TICK_S
from gateway.system.clock import Clock


class TickTimer:
    """Calls back when it is time, up to a tick later, or sooner: then the callee asks again."""

    def __init__(self, clock: Clock, call: Callable[[], None]) -> None:
        self._clock = clock
        self._call = call
        self._timer: asyncio.TimerHandle | None = None
        self._due_s = 0.0

    def at(self, due_s: float) -> None:
        """Call at `due_s`; a timer that runs out before that is left as it is, since most are put off."""
        if self._timer is not None and self._due_s <= due_s:
            return
        if due_s == math.inf:
            return
        now_s = self._clock.now_s()
        tick_s = math.ceil(max(due_s, now_s) / TICK_S) * TICK_S
        if self._timer is not None and self._due_s <= tick_s:
            return
        self.cancel()
        self._due_s = tick_s
        self._timer = asyncio.get_running_loop().call_later(self._due_s - now_s, self._run)

    def cancel(self) -> None:
        """Call no more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _run(self) -> None:
        self._timer = None
        self._call()
