"""The state of a starter with its alarms, published at once, and the events that follow from two readings."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from gateway.families.devices import alarms_of
from gateway.families.profile.schema import Profile
from gateway.families.profile.state import state_of
from gateway.records import Quality, Record, Severity
from gateway.starters.telemetry.decoding import is_flag
from gateway.starters.telemetry.emitter import Emitter
from gateway.starters.telemetry.reporting import TICK_S
from gateway.starters.telemetry.snapshot import Reading, Snapshot, Value, as_flag, good_values
from gateway.starters.telemetry.transitions import (
    LASTING_S,
    UNKNOWN,
    AlarmBook,
    AlarmStatus,
    Change,
    PublishedFaults,
    Settled,
    Watch,
)

STATE_EVERY_S = 30.0 - TICK_S  # the timer may run out a tick late
MOMENTS_BEFORE = 3  # sets of values that an event carries from before it
NUMBER_WITHIN_S = 10.0  # of the first reading of a run, until a fault is published without its number
FAULT, FAULT_CODE = "fault", "fault_code"
STATE = "state"  # among what settles; no point has this name
SUMMARY_FLAGS = (FAULT, "alarm")  # decide whether the alarms can be told at all


class Status:
    """Which records follow from each reading: the state when it changes, at the latest every 30 s."""

    def __init__(self, profile: Profile, publisher: Emitter, told: PublishedFaults | None = None) -> None:
        self._profile = profile
        self._publisher = publisher
        self._told = told or PublishedFaults()
        self._numbers = profile.alarm_points
        self._settled = Settled()
        self._settled_alarms = AlarmBook()
        self._state_since_s: float | None = None
        self._first_seen: tuple[float, dict[str, Any]] | None = None  # UTC, and the values before
        self._look_s: float | None = None  # steady clock, when the first fault of this run was settled
        self._fault_told_s: float | None = None
        self._flags = tuple(name for name in profile.points if is_flag(profile, name))
        self._status_flags = tuple(name for name in self._flags if profile.points[name].group == "status")
        self._summary_flags = tuple(name for name in SUMMARY_FLAGS if name in profile.points)
        self._watch = Watch()
        self._alarms = AlarmBook()
        self._before: deque[tuple[float, dict[str, Reading]]] = deque(maxlen=MOMENTS_BEFORE)
        self._fault_since_s: float | None = None  # steady clock, when the present fault was seen first
        self._sent: tuple[str, Quality, dict[str, Value], str] | None = None
        self._sent_s = -math.inf
        self._standing = -1  # of the snapshot that was looked at last
        self._state = UNKNOWN
        self._records: list[Record] = []  # made by the present look

    @property
    def next_due_s(self) -> float:
        """Return when the state is published again although nothing changed."""
        return self._sent_s + STATE_EVERY_S

    def expire(self) -> bool:
        """Have the state published again by the next look; return whether it ever was."""
        self._sent_s = -math.inf
        return self._sent is not None

    def remember(self, snapshot: Snapshot, *, now_s: float) -> None:
        """Keep the present values: they may become those before an event. Call before a status is applied."""
        if snapshot.has_good():
            self._before.append((now_s, dict(snapshot.readings)))

    @property
    def state(self) -> str:
        """Return the state as of the latest look."""
        return self._state

    def look(self, snapshot: Snapshot, *, now_s: float, utc_s: float, reason: str = "") -> Sequence[Record]:
        """Return what is to be published of a snapshot; where nothing is new this costs nothing.

        `reason` says why nothing is said of a starter that answers.
        """
        has_fault = self._fault_since_s is not None or self._settled.is_waiting  # then times matter too
        is_same = self._sent and snapshot.standing == self._standing and reason == self._sent[-1]
        if is_same and now_s < self.next_due_s and not has_fault:
            return ()
        self._standing = snapshot.standing
        values = snapshot.good_values()
        self._records = []
        state = self._state = state_of(self._profile, values)
        self._add_state(state, values, snapshot, now_s=now_s, reason=reason)
        shown = self._shown(snapshot, values)
        self._add_alarms(values, shown, utc_s=utc_s)
        self._add_events(snapshot, values, shown, now_s=now_s, utc_s=utc_s)
        return self._records

    @property
    def is_waiting(self) -> bool:
        """Return whether something has changed that a second reading must show before it is an event."""
        return self._settled.is_waiting

    def _add_events(
        self,
        snapshot: Snapshot,
        values: Mapping[str, Value],
        shown: Mapping[str, Value],
        *,
        now_s: float,
        utc_s: float,
    ) -> None:
        """Publish what two readings in a row say has happened, as of the first of them."""
        deciding = (*self._flags, *self._numbers)
        all_readings = snapshot.readings
        readings: dict[str, tuple[Any, float]] = {
            name: (values[name], all_readings[name].at_s or 0.0) for name in deciding if name in values
        }
        if self._state != UNKNOWN:
            self._watch.begin(self._state)
            # Of one reading as a whole: flags that settle one by one may never have stood together.
            readings[STATE] = (self._state, min([readings[n][1] for n in self._flags if n in readings]))
        self._settled.note(readings)
        since_s = self._settled.waiting_since_s(STATE)
        is_new_state = since_s not in (None, self._state_since_s)  # what else waited before began earlier
        self._state_since_s = since_s
        if is_new_state or (self._settled.is_waiting and self._first_seen is None):
            self._first_seen = (utc_s, self._values_before(now_s))
        first_s, before = self._first_seen or (utc_s, self._values_before(now_s))
        settled = self._settled.values
        state = str(settled.get(STATE, UNKNOWN))
        codes = self._add_alarm_events(settled, shown, utc_s=first_s)
        if state == "fault" and self._is_number_awaited(settled, now_s):
            return
        for change in self._watch.note(
            state,
            remote=as_flag(settled.get("remote")),
            time_s=first_s,
            is_known=self._told.is_told(self._publisher.starter, codes),
        ):
            self._records.append(self._publisher.change(change, time_s=first_s, more=before))
        self._remember_fault(state, codes, now_s=now_s)
        if not self._settled.is_waiting:
            self._first_seen = None

    def _add_alarm_events(
        self, settled: Mapping[str, Value], shown: Mapping[str, Value], *, utc_s: float
    ) -> tuple[str, ...]:
        """Publish the alarms that came or went, and return the codes of the faults that stand."""
        is_known = all(name in settled for name in self._summary_flags)
        if is_known and not self._settled.is_waiting_for(self._numbers):
            seen = {
                name: settled.get(name, value) for name, value in shown.items() if name not in self._flags
            }
            seen |= {name: settled.get(name) for name in self._flags}
            if shown.get(FAULT_CODE) is None:
                seen[FAULT_CODE] = None
            changed = self._settled_alarms.update(alarms_of(self._profile, seen), time_s=utc_s)
            came = {standing.alarm.severity for standing in changed if standing.is_active}
            for standing in changed:
                if standing.is_active or standing.alarm.severity not in came:
                    self._records.append(self._publisher.change(_alarm_change(standing), time_s=utc_s))
        return self._settled_alarms.active_codes("fault")

    def _is_number_awaited(self, settled: Mapping[str, Value], now_s: float) -> bool:
        """Return whether the number of a fault is needed to know whether an earlier run has published it."""
        if self._watch.has_looked or FAULT_CODE not in self._numbers or settled.get(FAULT_CODE):
            return False
        self._look_s = now_s if self._look_s is None else self._look_s
        return now_s - self._look_s < NUMBER_WITHIN_S

    def _remember_fault(self, state: str, codes: tuple[str, ...], *, now_s: float) -> None:
        """Have the next run know which fault was published, once its event is surely on the disk."""
        if state == UNKNOWN:
            return
        if state != "fault":
            self._fault_told_s = None
            self._told.note(self._publisher.starter, ())
            return
        self._fault_told_s = now_s if self._fault_told_s is None else self._fault_told_s
        if now_s - self._fault_told_s >= LASTING_S:
            self._told.note(self._publisher.starter, codes)

    def _add_state(
        self, state: str, values: Mapping[str, Value], snapshot: Snapshot, *, now_s: float, reason: str
    ) -> None:
        flags = {name: values.get(name) for name in self._flags}
        quality = self._quality(state, snapshot)
        said = (state, quality, flags, reason)
        if said == self._sent and now_s < self.next_due_s:
            return
        readings = snapshot.readings
        times = [readings[name].time_s for name in self._status_flags]
        time_s = min([each for each in times if each is not None], default=None)  # as old as its oldest part
        self._records.append(
            self._publisher.state(state, quality=quality, time_s=time_s, flags=flags, reason=reason)
        )
        self._sent, self._sent_s = said, now_s

    def _quality(self, state: str, snapshot: Snapshot) -> Quality:
        if state != UNKNOWN:
            return Quality.GOOD
        is_lost = any(snapshot.readings[name].quality is Quality.STALE for name in self._flags)
        return Quality.STALE if is_lost else Quality.BAD

    def _shown(self, snapshot: Snapshot, values: Mapping[str, Value]) -> dict[str, Value]:
        """Return all that was read, also a while ago, but no number of an earlier fault."""
        shown = {name: known.value for name, known in snapshot.readings.items()}  # numbers may be older,
        is_known = all(name in values for name in self._summary_flags)
        if is_known and not self._is_number_of_this_fault(snapshot, has_fault=bool(values.get(FAULT))):
            shown[FAULT_CODE] = (
                None  # but not from before this fault (ssw07 P014: the last fault, active or not)
            )
        return shown

    def _add_alarms(self, values: Mapping[str, Value], shown: Mapping[str, Value], *, utc_s: float) -> None:
        """Publish the alarms as they stand; nothing can be said while a summary flag is not known."""
        if any(name not in values for name in self._summary_flags):
            return
        for standing in self._alarms.update(alarms_of(self._profile, shown), time_s=utc_s):
            self._records.append(self._publisher.alarm(standing))

    def _is_number_of_this_fault(self, snapshot: Snapshot, *, has_fault: bool) -> bool:
        if not has_fault:
            self._fault_since_s = None
        elif self._fault_since_s is None:
            self._fault_since_s = snapshot.readings[FAULT].at_s
        number = snapshot.readings.get(FAULT_CODE)
        if number is None or number.at_s is None or self._fault_since_s is None:
            return True
        return number.at_s >= self._fault_since_s

    def _values_before(self, now_s: float) -> dict[str, Any]:
        return {
            "before": [
                {"seconds_before": round(now_s - at_s, 3), "values": good_values(readings)}
                for at_s, readings in self._before
            ]
        }


def _alarm_change(standing: AlarmStatus) -> Change:
    alarm = standing.alarm
    data = {"alarm": alarm.code, "severity": alarm.severity, "count": standing.count}
    if standing.is_active:
        severity = Severity.ERROR if alarm.severity == "fault" else Severity.WARNING
        return Change("alarm", severity, alarm.text, data)
    return Change("cleared", Severity.INFO, f"cleared: {alarm.text}", data)
