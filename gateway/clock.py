"""Time as the gateway sees it: a clock that never steps for intervals, and the wall's for time stamps."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """What the loops need of time; tests give a virtual one."""

    def now_s(self) -> float:
        """Return seconds on a clock that never steps; only differences mean anything."""
        ...

    def utc_s(self, at_s: float | None = None) -> float:
        """Return the wall time (seconds since 1970, UTC) of now, or of `at_s` on the steady clock."""
        ...


class SystemClock:
    """The machine's own clocks; the steady one is also asyncio's (`loop.time()`)."""

    def now_s(self) -> float:
        """Return `time.monotonic()`."""
        return time.monotonic()

    def utc_s(self, at_s: float | None = None) -> float:
        """Return the wall time; a stamp of the past is carried over by its distance from now."""
        age_s = 0.0 if at_s is None else time.monotonic() - at_s
        return time.time() - age_s
