"""How often the non-volatile memory of each starter is written: flash and EEPROM wear out.

No manual says how many writes they bear; 100,000 is usual for EEPROM, 10,000 for flash. A program that sets
the same row to and fro is stopped by the limit long before that is used up.
"""

from __future__ import annotations

import math
from collections import deque

HOUR_S = 3600.0
MOST_PER_HOUR = 120


class Wear:
    """Counts the writes of every starter, and refuses those that are too many within an hour."""

    def __init__(self, most_per_hour: int = MOST_PER_HOUR) -> None:
        self._most = most_per_hour
        self._times: dict[str, deque[float]] = {}
        self._totals: dict[str, int] = {}

    def take(self, starter: str, writes: int, *, now_s: float) -> float | None:
        """Count so many writes as done now; or return, and count nothing, in how many seconds they may be.

        Infinity when they are too many for any hour.
        """
        times = self._times.setdefault(starter, deque())
        while times and times[0] <= now_s - HOUR_S:
            times.popleft()
        excess = len(times) + writes - self._most
        if excess > 0 and writes:
            return times[excess - 1] + HOUR_S - now_s if excess <= len(times) else math.inf
        times.extend([now_s] * writes)
        self._totals[starter] = self.total(starter) + writes
        return None

    def total(self, starter: str) -> int:
        """Return how many writes this starter has had since the gateway began."""
        return self._totals.get(starter, 0)

    def refusal(self, wait_s: float) -> str:
        """Return in words why a command must wait so long."""
        limit = f"at most {self._most} writes an hour go to a starter's non-volatile memory, which wears out"
        if math.isinf(wait_s):
            return f"{limit}: these are more at once"
        return f"{limit}: try again in {math.ceil(wait_s / 60)} min"
