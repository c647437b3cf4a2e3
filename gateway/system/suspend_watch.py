"""Detects that the process or the machine stood still: what waited meanwhile is old."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable

LIMIT_S = 2.0  # shorter than any command is valid by default, longer than a busy machine's worst delay
LOOK_EVERY_S = 0.25


def up_s() -> float:
    """Return seconds on a clock that also runs while the machine sleeps."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class SuspendWatch:
    """Looks at two clocks again and again: a gap between two looks was a standstill.

    A stopped process (SIGSTOP, a debugger, a starved machine) and one that slept with its machine show on the
    first clock. A virtual machine that was paused shows on the second only, when that clock is set.
    """

    def __init__(
        self,
        now_s: Callable[[], float] = time.monotonic,
        *,
        up_s: Callable[[], float] = up_s,
        utc_s: Callable[[], float] = time.time,
    ) -> None:
        self.on_standstill: Callable[[float], None] = lambda _: None  # gets how long it lasted
        self._now_s = now_s  # the steady clock
        self._ended_s = -math.inf
        self._clocks = (up_s, utc_s)
        self._seen_s: tuple[float, ...] | None = None

    def look(self) -> None:
        """Notice a standstill that ended since the last look; to be called before any command is judged."""
        now_s = tuple(clock() for clock in self._clocks)
        seen_s, self._seen_s = self._seen_s or now_s, now_s
        longest_s = max(now - seen for now, seen in zip(now_s, seen_s, strict=True))
        if longest_s > LIMIT_S:
            self._ended_s = self._now_s()
            self.on_standstill(longest_s)

    def ended_s(self) -> float:
        """Look, and return when the latest standstill ended, on the steady clock."""
        self.look()
        return self._ended_s

    async def run(self, *, also: Callable[[], None]) -> None:
        """Look until cancelled, and call `also` each time."""
        while True:
            self.look()
            also()
            await asyncio.sleep(LOOK_EVERY_S)
