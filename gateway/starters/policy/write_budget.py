"""How often the non-volatile memory of each starter is written: flash and EEPROM wear out.

No manual says how many writes they bear; 100,000 is usual for EEPROM, 10,000 for flash. A program that sets
the same row to and fro is stopped by the limit long before that is used up.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping

from pydantic import NonNegativeInt, TypeAdapter

from gateway.contract import CommandError, ResultCode

HOUR_S = 3600.0
MOST_PER_HOUR = 120
WRITES_BORNE = 10_000  # by flash, usually; no manual says so
WRITES = TypeAdapter(dict[str, NonNegativeInt])  # totals by starter


class WriteBudget:
    """Counts the writes of every starter, and refuses those that are too many within an hour.

    `on_count` gets each count: the starter, and how many writes.
    """

    def __init__(
        self, most_per_hour: int = MOST_PER_HOUR, *, on_count: Callable[[str, int], None] | None = None
    ) -> None:
        self.most_per_hour = most_per_hour
        self._on_count = on_count
        self._times: dict[str, deque[float]] = {}
        self._totals: dict[str, int] = {}

    def take(self, starter: str, writes: int, *, now_s: float) -> None:
        """Count so many writes as done now; CommandError, and nothing is counted, when they are too many."""
        if not writes:
            return
        times = self._times.setdefault(starter, deque())
        while times and times[0] <= now_s - HOUR_S:
            times.popleft()
        excess = len(times) + writes - self.most_per_hour
        if excess > len(times):
            raise CommandError(ResultCode.WEAR_LIMIT, "never", most=self.most_per_hour)
        if excess > 0:
            minutes = math.ceil((times[excess - 1] + HOUR_S - now_s) / 60)
            raise CommandError(ResultCode.WEAR_LIMIT, "wait", most=self.most_per_hour, minutes=minutes)
        times.extend([now_s] * writes)
        self._totals[starter] = self.total(starter) + writes
        if self._on_count is not None:
            self._on_count(starter, writes)

    def total(self, starter: str) -> int:
        """Return how many writes this starter has had, as far back as is known."""
        return self._totals.get(starter, 0)

    def last_hour(self, starter: str) -> int:
        """Return how many of them are in the hour that counts for the limit."""
        return len(self._times.get(starter, ()))

    def totals(self) -> dict[str, int]:
        """Return the writes of each starter, to be stored."""
        return self._totals

    def restore(self, totals: Mapping[str, int]) -> None:
        """Go on from what an earlier run has stored."""
        self._totals = dict(totals)
