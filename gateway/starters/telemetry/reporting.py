"""What is published of one starter, and when: `Report` by exception, and `Emitter` its records.

A reading goes out when it differs from the one sent last by more than the point's deadband, or in quality; at
the soonest 0.25 s after that one and at the latest `refresh_s` after it. What is sent is always the newest.
To wake up for each point on its own would cost more than to send it, so old ones go out together.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from gateway.contract import (
    AlarmRecord,
    AvailabilityRecord,
    Event,
    EventCode,
    EventRecord,
    LockRecord,
    Presence,
    Quality,
    Record,
    RecordWriter,
    Severity,
    StarterState,
    StateRecord,
    ValueRecord,
)
from gateway.starters.telemetry.snapshot import Reading, Value
from gateway.starters.telemetry.transitions import AlarmStatus
from gateway.system.clock import Clock

TICK_S = 0.25  # all starters' timers run out on ticks, so that the loop wakes up once for many of them


class TickTimer:
    """Calls back when it is time, up to a tick later, or sooner: then the callee asks anew."""

    def __init__(self, clock: Clock, call: Callable[[], None]) -> None:
        self._clock = clock
        self._call = call
        self._timer: asyncio.TimerHandle | None = None
        self._due_s = 0.0

    def at(self, due_s: float) -> None:
        """Call at `due_s`; a timer that runs out before that is left as it is, since most are put off."""
        if due_s == math.inf:
            return
        now_s = self._clock.now_s()
        tick_s = math.ceil(max(due_s, now_s) / TICK_S) * TICK_S
        if self._timer is not None and self._due_s <= tick_s:
            return
        self.cancel()
        self._due_s = tick_s
        self._timer = asyncio.get_running_loop().call_later(self._due_s - now_s, self._run)

    def cancel(self) -> None:
        """Call no more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _run(self) -> None:
        self._timer = None
        self._call()


SOONEST_S = 0.25
REFRESH_S = 300.0  # `mqtt.refresh_s` where nothing else is configured
TOGETHER = 0.1  # of that time: so much sooner readings go out that were sent long ago, with one that must


@dataclass(slots=True)
class _Reported:
    sent: Reading | None = None
    sent_s: float = -math.inf
    changed_s: float = math.inf  # when a reading that says something else is due


class Report:
    """When the readings of one starter are due; they stay where they are, in `readings`."""

    def __init__(
        self,
        readings: Mapping[str, Reading],
        deadbands: Mapping[str, float],
        *,
        refresh_s: float = REFRESH_S,
    ) -> None:
        self._readings = readings  # always the newest
        self._deadbands = deadbands  # in the point's unit; a missing one is 0
        self._entries: dict[str, _Reported] = {}
        self._next_due_s = math.inf  # no reading is due before
        self.set_refresh(refresh_s)

    def set_refresh(self, refresh_s: float) -> None:
        """Publish unchanged readings again this long after they were sent, from now on."""
        self._latest_s = max(refresh_s - TICK_S, SOONEST_S)  # the timer may run out a tick late
        self._look_ahead()

    def note_changed(self, names: Iterable[str], *, now_s: float) -> None:
        """Record which readings say something else than before; a point that is new here is due at once."""
        for name in names:
            entry = self._entries.get(name)
            if entry is None:
                self._entries[name] = _Reported()
                self._next_due_s = min(self._next_due_s, now_s)
            elif entry.sent is not None and is_news(
                entry.sent, self._readings[name], self._deadbands.get(name, 0.0)
            ):
                entry.changed_s = min(entry.changed_s, max(now_s, entry.sent_s + SOONEST_S))
                self._next_due_s = min(self._next_due_s, entry.changed_s)

    def take_due(self, now_s: float) -> dict[str, Reading]:
        """Return what is to be published now, and count it as sent."""
        due: dict[str, Reading] = {}
        if now_s < self._next_due_s:
            return due
        old_s = now_s - self._latest_s * (1 - TOGETHER)
        for name, entry in self._entries.items():
            if entry.changed_s <= now_s or entry.sent_s <= old_s:
                due[name] = entry.sent = self._readings[name]
                entry.sent_s, entry.changed_s = now_s, math.inf
        self._look_ahead()
        return due

    def next_due_s(self) -> float:
        """Return when the next reading is due; infinite when there is none."""
        return self._next_due_s

    def _look_ahead(self) -> None:
        next_due_s = math.inf
        for entry in self._entries.values():  # compared one by one: this runs at each publication
            refresh_s = entry.sent_s + self._latest_s
            due_s = entry.changed_s if entry.changed_s < refresh_s else refresh_s
            if due_s < next_due_s:
                next_due_s = due_s
        self._next_due_s = next_due_s


def is_news(sent: Reading, now: Reading, deadband: float) -> bool:
    """Return whether a reading differs enough from the one sent last to be published before its time."""
    marks = (sent.quality, sent.label, sent.reason), (now.quality, now.label, now.reason)
    if marks[0] != marks[1] or type(sent.value) is not type(now.value):
        return True
    if isinstance(sent.value, (str, bool)) or sent.value is None or now.value is None:
        return sent.value != now.value
    return abs(float(now.value) - float(sent.value)) > deadband


LockOf = Callable[[str], LockRecord | None]


class Emitter:
    """Puts the records of one starter into the sink."""

    def __init__(
        self,
        starter: str,
        records: RecordWriter,
        *,
        lock_of: LockOf = lambda _: None,
    ) -> None:
        self.starter = starter
        self._lock_of = lock_of
        self._records = records
        self._sink = records.sink
        self._clock = records.clock
        self._sequence = records.sequence
        self._boot = records.boot

    def put(self, *records: Record) -> None:
        """Publish records, in order."""
        for record in records:
            self._sink.put(record)

    def event(
        self, event: EventCode | Event, case: str = "", /, *, severity: Severity | None = None, **fields: Any
    ) -> None:
        """Publish something that happened now, as `event_of` makes it."""
        self._records.event(self.starter, event, case, severity=severity, **fields)

    def availability(self, state: Presence, *, reason: str | None) -> None:
        """Publish that the starter is online, offline or disabled from now on."""
        self.put(
            AvailabilityRecord(starter=self.starter, state=state, since_s=self._clock.utc_s(), reason=reason)
        )

    def values(self, readings: Mapping[str, Reading]) -> None:
        """Publish readings, by point."""
        for point, reading in readings.items():
            self._sink.put(
                ValueRecord(
                    starter=self.starter,
                    point=point,
                    value=reading.value,
                    unit=reading.unit,
                    quality=reading.quality,
                    time_s=reading.time_s,
                    seq=next(self._sequence),
                    boot=self._boot,
                    label=reading.label,
                    reason=reading.reason,
                )
            )

    # Records that are made where something is decoded, and published after that.

    def state(
        self,
        state: StarterState,
        *,
        quality: Quality,
        time_s: float | None,
        flags: Mapping[str, Value],
        reason: str = "",
        fault_code: Value = None,
    ) -> StateRecord:
        """Return the state with its boolean points, and the starter's lock."""
        known = {name: value if isinstance(value, bool) else None for name, value in flags.items()}
        seq, lock = next(self._sequence), self._lock_of(self.starter)
        number = fault_code if isinstance(fault_code, int) else None
        return StateRecord(
            starter=self.starter,
            state=state,
            quality=quality,
            time_s=time_s,
            seq=seq,
            boot=self._boot,
            flags=known,
            lock=lock,
            reason=reason,
            fault_code=number,
        )

    def alarm(self, standing: AlarmStatus) -> AlarmRecord:
        """Return one fault or alarm as it stands."""
        return AlarmRecord(
            starter=self.starter,
            code=standing.alarm.code,
            is_active=standing.is_active,
            severity=standing.alarm.severity,
            text=standing.alarm.text,
            time_s=standing.raised_s,
            cleared_s=standing.cleared_s,
            count=standing.count,
            seq=next(self._sequence),
            boot=self._boot,
        )

    def dated(
        self, event: Event, *, time_s: float | None = None, before: Sequence[Mapping[str, Any]] | None = None
    ) -> EventRecord:
        """Return the record of an event, of now or `time_s`, with the values of the seconds before it."""
        known = event if before is None else replace(event, data={**event.data, "before": before})
        return self._records.dated(self.starter, known, time_s=time_s)
