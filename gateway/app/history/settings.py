"""The part of a starter's history that stores settings which somebody else than the gateway has changed.

The background reading of the settings finds them and publishes the event `parameter_changed`; nothing more is
read for it. What commands have changed is in the audit.
"""

from __future__ import annotations

from collections.abc import Sequence

from gateway.app.history.part import Surroundings
from gateway.history.readings import Readings
from gateway.records import EventRecord, Record, rfc3339
from gateway.starters.services.parameter_monitor import EVENT
from gateway.starters.setup import StarterSetup
from gateway.storage.history_table import HistoryRow

KIND = "setting"  # of the rows on disk
STORED = 100  # of each starter


class SettingsPart:
    """Implements `HistoryPart`."""

    kinds: tuple[str, ...] = ()  # earlier ones stay on the disk

    def __init__(self, setup: StarterSetup, here: Surroundings) -> None:
        self._name = setup.name
        self._here = here

    def take_readings(self, readings: Readings) -> None:
        """Do nothing."""

    def take_record(self, record: Record) -> None:
        """Store a changed setting within a few seconds."""
        if isinstance(record, EventRecord) and record.code == EVENT:
            data = {"time": rfc3339(record.time_s), **record.data}
            id_ = f"{self._here.boot}-{record.seq}"
            self._here.store.put(self._name, KIND, id_, time_s=record.time_s, data=data, limit=STORED)

    def restore(self, rows: Sequence[HistoryRow]) -> None:
        """Do nothing."""

    def follow(self, setup: StarterSetup) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""
