"""How often the non-volatile memory of each starter is written: flash and EEPROM wear out.

No manual says how many writes they bear; 100,000 is usual for EEPROM, 10,000 for flash. A program that sets
the same row to and fro is stopped by the limit long before that is used up.
"""

from __future__ import annotations

import math
from collections import deque

from pydantic import NonNegativeInt, TypeAdapter

from gateway.contract import CommandError, EventCode, RecordWriter, ResultCode
from gateway.store import Documents

HOUR_S = 3600.0
MOST_PER_HOUR = 120
WRITES_BORNE = 10_000  # by flash, usually; no manual says so
WRITES = TypeAdapter(dict[str, NonNegativeInt])  # totals by starter


class WriteBudget:
    """Counts the writes of every starter, and refuses those that are too many within an hour.

    The totals are stored, as far back as is known; a lost count is no event.
    """

    def __init__(self, records: RecordWriter, documents: Documents) -> None:
        self._records = records
        self._times: dict[str, deque[float]] = {}
        self._document = documents.open("writes", WRITES, lambda: self._totals)
        self._totals = dict(self._document.loaded or {})

    def take(self, starter: str, writes: int, *, now_s: float) -> None:
        """Count so many writes as done now; CommandError, and nothing is counted, when they are too many."""
        times, most = self._times.setdefault(starter, deque()), MOST_PER_HOUR
        while times and times[0] <= now_s - HOUR_S:
            times.popleft()
        excess = len(times) + writes - most
        if excess > len(times):
            raise CommandError(ResultCode.WEAR_LIMIT, "never", most=most)
        if excess > 0:
            minutes = math.ceil((times[excess - 1] + HOUR_S - now_s) / 60)
            raise CommandError(ResultCode.WEAR_LIMIT, "wait", most=most, minutes=minutes)
        times.extend([now_s] * writes)
        total = self._totals[starter] = self._totals.get(starter, 0) + writes
        self._document.touch()
        last_hour, event = len(times), self._records.event
        event(starter, EventCode.MEMORY_WRITTEN, last_hour=last_hour, total=total, writes=writes, limit=most)
