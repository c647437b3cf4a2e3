"""The records of one starter: made of its state, numbered, and put into the sink."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from gateway.contract import (
    AlarmRecord,
    AvailabilityRecord,
    Event,
    EventCode,
    LockRecord,
    Presence,
    Record,
    RecordWriter,
    Severity,
    StateRecord,
    ValueRecord,
)
from gateway.starters.state.alarms import AlarmStatus
from gateway.starters.state.readings import Points
from gateway.starters.state.settled import FirstSeen
from gateway.starters.state.starter_state import Happenings, Status

LockOf = Callable[[str], LockRecord | None]


class Emitter:
    """Publishes what is said of one starter."""

    def __init__(self, starter: str, records: RecordWriter, *, lock_of: LockOf = lambda _: None) -> None:
        self.starter = starter
        self._records = records
        self._lock_of = lock_of

    def put(self, record: Record) -> None:
        """Publish a record."""
        self._records.sink.put(record)

    def event(
        self, event: EventCode | Event, case: str = "", /, *, severity: Severity | None = None, **fields: Any
    ) -> None:
        """Publish something that happened now, as `event_of` makes it."""
        self._records.event(self.starter, event, case, severity=severity, **fields)

    def availability(self, state: Presence, *, reason: str | None) -> None:
        """Publish that the starter is online, offline or disabled from now on."""
        since_s = self._records.clock.utc_s()
        self.put(AvailabilityRecord(starter=self.starter, state=state, since_s=since_s, reason=reason))

    def state(self, status: Status, *, time_s: float | None, reason: str) -> None:
        """Publish the state with its booleans, and the starter's lock."""
        self.put(
            StateRecord(
                starter=self.starter,
                state=status.word,
                quality=status.quality,
                time_s=time_s,
                seq=next(self._records.sequence),
                boot=self._records.boot,
                flags={
                    name: value if isinstance(value, bool) else None for name, value in status.flags.items()
                },
                lock=self._lock_of(self.starter),
                reason=reason,
                fault_code=status.number,
            )
        )

    def values(self, readings: Points) -> None:
        """Publish readings, by point."""
        sink, boot, sequence = self._records.sink, self._records.boot, self._records.sequence
        for point, reading in readings.items():
            sink.put(
                ValueRecord(
                    starter=self.starter,
                    point=point,
                    value=reading.value,
                    unit=reading.unit,
                    quality=reading.quality,
                    time_s=reading.time_s,
                    seq=next(sequence),
                    boot=boot,
                    label=reading.label,
                    reason=reading.reason,
                )
            )

    def happenings(self, happenings: Happenings, points: Iterable[str]) -> None:
        """Publish alarms that came or went, and events with the values of these points before them."""
        for happening in happenings:
            if isinstance(happening, AlarmStatus):
                self._alarm(happening)
                continue
            event, first = happening.event, happening.first
            if first is not None:
                event = replace(event, data={**event.data, "before": _before(first, points)})
            self.put(self._records.dated(self.starter, event, time_s=happening.time_s))

    def _alarm(self, known: AlarmStatus) -> None:
        self.put(
            AlarmRecord(
                starter=self.starter,
                code=known.alarm.code,
                is_active=known.is_active,
                severity=known.alarm.severity,
                text=known.alarm.text,
                time_s=known.raised_s,
                cleared_s=known.cleared_s,
                count=known.count,
                seq=next(self._records.sequence),
                boot=self._records.boot,
            )
        )


def _before(first: FirstSeen, points: Iterable[str]) -> list[dict[str, Any]]:
    """Return the values that were good before an event, the oldest first."""
    names = tuple(points)
    found: list[dict[str, Any]] = []
    for then in first.earlier:
        good = {name: value for name, value in zip(names, then.values, strict=True) if value is not None}
        if good:
            found.append({"seconds_before": round(first.now_s - then.at_s, 3), "values": good})
    return found
