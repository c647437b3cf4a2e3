"""The part of a starter's history that stores settings which somebody else than the gateway has changed.

The background reading of the settings finds them and publishes the event `parameter_changed`; nothing more is
read for it. What commands have changed is in the audit.
"""

from __future__ import annotations

from gateway.contract import EventCode, EventRecord, Record, rfc3339
from gateway.plugins.history.service.part import HistoryPart

KIND = "setting"  # of the rows on disk
STORED = 100  # of each starter


class SettingsPart(HistoryPart):
    """Stores what changed; earlier ones stay on the disk."""

    def take_record(self, record: Record) -> None:
        """Store a changed setting within a few seconds."""
        if isinstance(record, EventRecord) and record.code == EventCode.PARAMETER_CHANGED:
            data = {"time": rfc3339(record.time_s), **record.data}
            self._put(KIND, f"{self._here.boot}-{record.seq}", data, limit=STORED)
