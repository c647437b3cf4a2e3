"""Measures this run's start and end, for the next restart."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable
from pathlib import Path

from gateway.app.restart.gaps import RestartTimes, stored_times
from gateway.errors import StoreError
from gateway.records import Quality, Record, StateRecord
from gateway.storage.json_file import JsonStore

SETTLED_S = 30.0  # after the start: each starter that answers has done so
SAVED_WITHIN_S = 1.0

_TICKS_S = os.sysconf("SC_CLK_TCK")
_IMPORTED_S = time.monotonic()


class RestartWatch:
    """Measures this run's start and end; subscribes to the records. All calls on the app's loop."""

    takes = (StateRecord,)

    def __init__(self, store: JsonStore, *, running_s: Callable[[], float] | None = None) -> None:
        self._store = store
        self._running_s = running_s or process_age_s
        before = stored_times(store)
        self._stop_s = before.stop_s
        self._start_s = dict(before.start_s)
        self._seen: set[str] = set()

    @property
    def times(self) -> RestartTimes:
        """Return what is known now."""
        return RestartTimes(self._stop_s, dict(self._start_s))

    def put(self, record: Record) -> None:
        """Note when the first state of a starter was read."""
        if (
            isinstance(record, StateRecord)
            and record.quality is Quality.GOOD
            and record.starter not in self._seen
        ):
            self._seen.add(record.starter)
            age_s = self._running_s()
            if age_s <= SETTLED_S:  # later than that it was not the restart that took so long
                self._start_s[record.starter] = round(age_s, 3)

    async def run(self) -> None:
        """Save once the start is over."""
        await asyncio.sleep(SETTLED_S)
        await self._save()

    async def ended(self, stop_s: float) -> None:
        """Save how long the end has taken; the last thing that is done."""
        self._stop_s = round(stop_s, 3)
        saving = asyncio.create_task(self._save())
        await asyncio.wait((saving,), timeout=SAVED_WITHIN_S)

    async def _save(self) -> None:
        try:
            await self._store.save({"stop_s": self._stop_s, "start_s": self._start_s})
        except StoreError:
            return  # the next restart is judged by what was measured before


def process_age_s() -> float:
    """Return how long this process exists [proc(5), starttime]; since this import where that fails."""
    try:
        fields = Path("/proc/self/stat").read_text("ascii").rpartition(")")[2].split()
        started_s = int(fields[19]) / _TICKS_S
    except (OSError, ValueError, IndexError):
        return time.monotonic() - _IMPORTED_S
    return time.clock_gettime(time.CLOCK_BOOTTIME) - started_s
