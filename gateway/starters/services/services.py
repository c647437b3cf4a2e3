"""The background services of each starter: the watch over its settings, and its past.

Both begin once the starter is identified. They ask for what no poll reads, when nothing else is to be asked.
"""

from __future__ import annotations

from collections.abc import Coroutine
from typing import Any

from gateway.contract import EventCode, EventRecord, Record, StateRecord
from gateway.starters.services.past_reader import PastListener, PastReader
from gateway.starters.services.settings import EVERY_S, SettingsWatch
from gateway.starters.starter import StarterTelemetry


class StarterServices:
    """The services of all starters; subscribes to the records, to know what trips and what has started."""

    takes = (EventRecord, StateRecord)

    def __init__(self, *, monitor_every_s: float = EVERY_S, past: PastListener | None = None) -> None:
        self._monitor_every_s = monitor_every_s
        self._past = past  # receives what starters say of their past; None: they are not asked
        self._settings: dict[str, SettingsWatch] = {}
        self._pasts: dict[str, PastReader] = {}
        self._states: dict[str, str] = {}  # of each starter, to see the end of a start

    def add(self, starter: StarterTelemetry) -> None:
        """Serve this starter too."""
        name = starter.setup.name
        settings = SettingsWatch(starter, starter.settings_recalled(), every_s=self._monitor_every_s)
        self._settings[name] = settings
        starter.when_identified(settings.begin)
        starter.on_written = settings.note_written
        if self._past is not None:
            self._pasts[name] = PastReader(starter, self._past)
            starter.when_identified(self._pasts[name].begin)

    def remove(self, starter: str) -> Coroutine[Any, Any, None]:
        """Leave a starter, whose name another may have at once; await what is returned."""
        self._states.pop(starter, None)
        return _close(self._settings.pop(starter), self._pasts.pop(starter, None))

    async def close(self) -> None:
        """Do nothing more."""
        for name in tuple(self._settings):
            await self.remove(name)

    def put(self, record: Record) -> None:
        """Ask a starter for its own record of a trip or a start."""
        if (
            isinstance(record, EventRecord)
            and record.code == EventCode.FAULT
            and record.starter in self._pasts
        ):
            self._pasts[record.starter].read_fault()
        if isinstance(record, StateRecord):
            before, self._states[record.starter] = self._states.get(record.starter), record.state
            if before == "starting" and record.state == "running" and record.starter in self._pasts:
                self._pasts[record.starter].read_start()


async def _close(*services: SettingsWatch | PastReader | None) -> None:
    for each in services:
        if each is not None:
            await each.close()
