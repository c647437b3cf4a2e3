"""One starter's voice: turns what is known into records with their time and number."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.clock import Clock
from gateway.starters.alarms import Standing
from gateway.starters.changes import Change
from gateway.starters.records import (
    AlarmRecord,
    AvailabilityRecord,
    EventRecord,
    Quality,
    Severity,
    Sink,
    StateRecord,
    ValueRecord,
)
from gateway.starters.sequence import Sequence
from gateway.starters.snapshot import Reading, Value, as_flag


class Publisher:
    """Puts the records of one starter into the sink."""

    def __init__(self, starter: str, *, sink: Sink, clock: Clock, sequence: Sequence) -> None:
        self.starter = starter
        self.sink = sink
        self._clock = clock
        self._sequence = sequence

    def value(self, point: str, reading: Reading) -> None:
        """Publish one point's reading."""
        self.sink.put(
            ValueRecord(
                starter=self.starter,
                point=point,
                value=reading.value,
                unit=reading.unit,
                quality=reading.quality,
                time_s=reading.time_s,
                seq=self._sequence.take(),
                label=reading.label,
                reason=reading.reason,
            )
        )

    def state(
        self, state: str, *, quality: Quality, time_s: float | None, flags: Mapping[str, Value]
    ) -> None:
        """Publish the state with its boolean points."""
        seq = self._sequence.take()
        self.sink.put(
            StateRecord(
                self.starter,
                state,
                quality,
                time_s,
                seq,
                {name: as_flag(value) for name, value in flags.items()},
            )
        )

    def availability(self, state: str, *, reason: str | None) -> None:
        """Publish that the starter is online, offline or disabled from now on."""
        self.sink.put(AvailabilityRecord(self.starter, state, self._clock.utc_s(), reason))

    def alarm(self, standing: Standing) -> None:
        """Publish one fault or alarm as it stands."""
        self.sink.put(
            AlarmRecord(
                starter=self.starter,
                code=standing.alarm.code,
                is_active=standing.is_active,
                severity=standing.alarm.severity,
                text=standing.alarm.text,
                time_s=standing.raised_s,
                cleared_s=standing.cleared_s,
                count=standing.count,
                seq=self._sequence.take(),
            )
        )

    def change(
        self, change: Change, *, time_s: float | None = None, more: Mapping[str, Any] | None = None
    ) -> None:
        """Publish something that happened, now or at `time_s`, with what else is known of it."""
        self.sink.put(
            EventRecord(
                starter=self.starter,
                code=change.code,
                severity=change.severity,
                text=change.text,
                time_s=self._clock.utc_s() if time_s is None else time_s,
                seq=self._sequence.take(),
                data={**change.data, **(more or {})},
            )
        )

    def event(self, code: str, severity: Severity, text: str, data: Mapping[str, Any] | None = None) -> None:
        """Publish something that happened now."""
        self.change(Change(code, severity, text, data or {}))
