"""A report whose readings are handed to it one by one."""

from __future__ import annotations

from collections.abc import Mapping

from gateway.starters.telemetry.reporting import Report
from gateway.starters.telemetry.snapshot import Reading


class OfferedReport(Report):
    """As telemetry has it: the readings are stored first, then it is noted which have changed."""

    def __init__(self, deadbands: Mapping[str, float]) -> None:
        self._offered: dict[str, Reading] = {}
        super().__init__(self._offered, deadbands)

    def offer(self, readings: Mapping[str, Reading], *, now_s: float) -> None:
        """Store readings that say something else than before."""
        self._offered.update(readings)
        self.note_changed(readings, now_s=now_s)
