"""The state of a starter with its alarms, published at once, and the events that follow from two readings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from gateway.contract import Quality, Record, StarterState
from gateway.families import Alarm, Profile, device_of, once_per_profile, reading, state_of
from gateway.starters.telemetry.decoding import flags_of
from gateway.starters.telemetry.reporting import TICK_S, Emitter
from gateway.starters.telemetry.snapshot import Reading, Snapshot, Value, as_flag
from gateway.starters.telemetry.transitions import (
    LASTING_S,
    UNKNOWN,
    AlarmBook,
    PublishedFaults,
    Settled,
    Watch,
    alarm_event,
)

STATE_EVERY_S = 30.0 - TICK_S  # the timer may run out a tick late
MOMENTS_BEFORE = 3  # sets of values that an event carries from before it
NUMBER_WITHIN_S = 10.0  # of a fault's first reading; then it is published without its number
NONE_FOR_S = 2.0  # a starter that gives 0 as the number for so long has none to give
FAULT, FAULT_CODE = "fault", "fault_code"
STATE = "state"  # among what settles; no point has this name
SUMMARY_FLAGS = (FAULT, "alarm")  # decide whether the alarms are known at all

Values = Sequence[Mapping[str, Any]]  # of the seconds before an event, the oldest first


@once_per_profile
def status_codes(profile: Profile) -> frozenset[str]:
    """Return the rows that say whether there is a fault or an alarm."""
    return frozenset(
        reading.rows_of_points(profile, (name for name in SUMMARY_FLAGS if name in profile.points))
    )


class Status:
    """Which records follow from each reading: the state when it changes, at the latest every 30 s."""

    def __init__(self, profile: Profile, emitter: Emitter, published: PublishedFaults | None = None) -> None:
        self._profile = profile
        self._device = device_of(profile)
        self._emitter = emitter
        self._published = published or PublishedFaults()
        self._numbers = profile.alarm_points
        self._settled = Settled()
        self._settled_alarms = AlarmBook()
        self._state_since_s: float | None = None
        self._first_seen: tuple[float, Values] | None = None  # UTC, and the values before
        self._held: tuple[float, Values] | None = None  # the same of a fault without its number
        self._announced: set[str] = set()  # faults of which an event was published
        self._fault_published_s: float | None = None
        self._flags = flags_of(profile)
        self._status_flags = tuple(name for name in self._flags if profile.points[name].group == "status")
        self._summary_flags = tuple(name for name in SUMMARY_FLAGS if name in profile.points)
        self._watch = Watch()
        self._alarms = AlarmBook()
        self._unnumbered_s: float | None = None  # since when the present fault has no number
        self._points = tuple(profile.points)  # in the order of every snapshot's readings
        self._before: tuple[tuple[float, tuple[Value, ...]], ...] = ()  # moments; None: it was not good
        self._fault_since_s: float | None = None  # steady clock, when the present fault was seen first
        self._sent: tuple[str, Quality, dict[str, Value], Value, str] | None = None
        self.next_due_s = -math.inf  # when the state is published again although nothing changed
        self._standing = -1  # of the snapshot that was looked at last
        self.state: StarterState = "unknown"  # as of the latest look
        self._records: list[Record] = []  # made by the present look

    def expire(self) -> bool:
        """Have the state published again by the next look; return whether it ever was."""
        self.next_due_s = -math.inf
        return self._sent is not None

    def remember(self, snapshot: Snapshot, *, now_s: float) -> None:
        """Keep the present values: they may become those before an event. Call before a status is applied."""
        if snapshot.has_good():
            good, readings = Quality.GOOD, snapshot.readings.values()
            values = [each.value if each.quality is good else None for each in readings]  # no generator
            self._before = (*self._before[1 - MOMENTS_BEFORE :], (now_s, tuple(values)))

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
        state = self.state = state_of(self._profile, values)
        shown = self._shown(snapshot, values)
        number = (shown.get(FAULT_CODE) or None) if values.get(FAULT) else None
        self._add_state(state, values, snapshot, number, now_s=now_s, reason=reason)
        is_awaited = self._is_number_awaited(snapshot, now_s)
        self._add_alarms(values, shown, is_awaited=is_awaited, utc_s=utc_s)
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
        first_s, before = self._note_readings(snapshot, values, now_s=now_s, utc_s=utc_s) or (utc_s, None)
        settled = self._settled.values
        state = str(settled.get(STATE, UNKNOWN))
        is_awaited = self._is_number_awaited(snapshot, now_s)
        self._settle_alarms(settled, shown, is_awaited=is_awaited, utc_s=first_s)
        if state == "fault" and not self._watch.is_in_fault and self._is_held(snapshot, now_s):
            self._held = self._held or (first_s, self._values_before(now_s) if before is None else before)
            return
        remote = as_flag(settled.get("remote"))
        if self._held is not None:
            self._add_changes("fault", remote, *self._held, now_s=now_s)
            self._held = None
        self._add_changes(state, remote, first_s, before, now_s=now_s)
        self._remember_fault(state, now_s=now_s)
        if not self._settled.is_waiting:
            self._first_seen = None

    def _note_readings(
        self, snapshot: Snapshot, values: Mapping[str, Value], *, now_s: float, utc_s: float
    ) -> tuple[float, Values] | None:
        """Record the readings that decide; return since when news waits, and the values before it."""
        deciding = (*self._flags, *self._numbers)
        all_readings = snapshot.readings
        readings: dict[str, tuple[Any, float]] = {
            name: (values[name], all_readings[name].at_s or 0.0) for name in deciding if name in values
        }
        if self.state != UNKNOWN:
            self._watch.begin(self.state)
            # Of one reading as a whole: flags that settle one by one may never have stood together.
            readings[STATE] = (self.state, min([readings[n][1] for n in self._flags if n in readings]))
        self._settled.note(readings)
        since_s = self._settled.waiting_since_s(STATE)
        is_new_state = since_s not in (None, self._state_since_s)  # what else waited before began earlier
        self._state_since_s = since_s
        if is_new_state or (self._settled.is_waiting and self._first_seen is None):
            self._first_seen = (utc_s, self._values_before(now_s))
        return self._first_seen

    def _add_changes(
        self,
        state: str,
        remote: bool | None,  # noqa: FBT001 - a reading, not an option
        time_s: float,
        before: Values | None,
        *,
        now_s: float,
    ) -> None:
        """Publish what became of the state, then the faults that came while it was a fault already.

        `before` are the values before that; None: those before now.
        """
        faults = self._settled_alarms.active("fault")
        codes = tuple(each.alarm.code for each in faults)
        was_in_fault = self._watch.is_in_fault
        for event in self._watch.note(
            state,
            remote=remote,
            time_s=time_s,
            is_known=self._published.has(self._emitter.starter, codes),
            faults=faults,
        ):
            values = self._values_before(now_s) if before is None else before
            self._records.append(self._emitter.dated(event, time_s=time_s, before=values))
        if not self._watch.is_in_fault:
            return
        for standing in faults:
            if was_in_fault and standing.alarm.code not in self._announced:
                self._records.append(self._emitter.dated(alarm_event(standing), time_s=standing.raised_s))
        self._announced = set(codes)

    def _settle_alarms(
        self,
        settled: Mapping[str, Value],
        shown: Mapping[str, Value],
        *,
        is_awaited: bool,
        utc_s: float,
    ) -> None:
        """Publish the alarms that came or went, and the faults that went; those that come make a trip."""
        is_known = all(name in settled for name in self._summary_flags)
        if not is_known or self._settled.is_waiting_for(self._numbers):
            return
        seen = {name: settled.get(name, value) for name, value in shown.items() if name not in self._flags}
        seen |= {name: settled.get(name) for name in self._flags}
        if shown.get(FAULT_CODE) is None:
            seen[FAULT_CODE] = None
        changed = self._settled_alarms.update(self._active(seen, is_awaited=is_awaited), time_s=utc_s)
        came = {standing.alarm.severity for standing in changed if standing.is_active}
        for standing in changed:
            alarm = standing.alarm
            if standing.is_active and alarm.severity == "fault":
                continue
            if not standing.is_active and alarm.severity == "fault" and alarm.code not in self._announced:
                passed = replace(standing, is_active=True)  # gone before the whole state was read twice
                self._records.append(self._emitter.dated(alarm_event(passed), time_s=standing.raised_s))
            if standing.is_active or alarm.severity not in came:
                self._records.append(self._emitter.dated(alarm_event(standing), time_s=utc_s))
            self._announced.discard(alarm.code)

    def _active(self, points: Mapping[str, Value], *, is_awaited: bool) -> list[Alarm]:
        """Return the faults and alarms that are active; no fault without a number while that is awaited."""
        active = self._device.alarms(self._profile, points)
        return [each for each in active if not (is_awaited and each.code == FAULT)]

    def _is_number_awaited(self, snapshot: Snapshot, now_s: float) -> bool:
        """Return whether the number of the present fault may still come: one trip is one alarm."""
        since_s, number = self._fault_since_s, snapshot.readings.get(FAULT_CODE)
        if since_s is None or number is None:
            return False
        if self._is_perhaps_over(number, now_s):
            return True
        if now_s - since_s >= NUMBER_WITHIN_S:
            return False
        if number.at_s is None or number.at_s < since_s:
            is_refused = number.at_s is not None and number.quality is Quality.BAD
            return not is_refused
        return not number.value and now_s - since_s < NONE_FOR_S

    def _is_perhaps_over(self, number: Reading, now_s: float) -> bool:
        """Return whether a fault has lost its number a moment ago: a reset, which clears the fault too."""
        if number.value != 0:
            self._unnumbered_s = None
            return False
        is_unnumbered = any(standing.alarm.code == FAULT for standing in self._alarms.active("fault"))
        if self._unnumbered_s is None:
            self._unnumbered_s = now_s
        return not is_unnumbered and now_s - self._unnumbered_s < NONE_FOR_S

    def _is_held(self, snapshot: Snapshot, now_s: float) -> bool:
        """Return whether a fault's event waits for its number, read once or not at all since the fault."""
        is_late = self._fault_since_s is not None and now_s - self._fault_since_s >= NUMBER_WITHIN_S
        is_read_once = self._settled.is_waiting_for(self._numbers)
        return (is_read_once and not is_late) or self._is_number_awaited(snapshot, now_s)

    def _remember_fault(self, state: str, *, now_s: float) -> None:
        """Have the next run know which fault was published, once its event is surely on the disk."""
        if state == UNKNOWN:
            return
        if state != "fault":
            self._fault_published_s = None
            self._published.note(self._emitter.starter, ())
            return
        self._fault_published_s = now_s if self._fault_published_s is None else self._fault_published_s
        if now_s - self._fault_published_s >= LASTING_S:
            codes = tuple(each.alarm.code for each in self._settled_alarms.active("fault"))
            self._published.note(self._emitter.starter, codes)

    def _add_state(
        self,
        state: StarterState,
        values: Mapping[str, Value],
        snapshot: Snapshot,
        number: Value,
        *,
        now_s: float,
        reason: str,
    ) -> None:
        flags = {name: values.get(name) for name in self._flags}
        quality = self._quality(state, snapshot)
        said = (state, quality, flags, number, reason)
        if said == self._sent and now_s < self.next_due_s:
            return
        readings = snapshot.readings
        times = [readings[name].time_s for name in self._status_flags]
        time_s = min([each for each in times if each is not None], default=None)  # as old as its oldest part
        self._records.append(
            self._emitter.state(
                state, quality=quality, time_s=time_s, flags=flags, reason=reason, fault_code=number
            )
        )
        self._sent, self.next_due_s = said, now_s + STATE_EVERY_S

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

    def _add_alarms(
        self, values: Mapping[str, Value], shown: Mapping[str, Value], *, is_awaited: bool, utc_s: float
    ) -> None:
        """Publish the alarms as they stand; nothing can be said while a summary flag is not known."""
        if any(name not in values for name in self._summary_flags):
            return
        for standing in self._alarms.update(self._active(shown, is_awaited=is_awaited), time_s=utc_s):
            self._records.append(self._emitter.alarm(standing))

    def _is_number_of_this_fault(self, snapshot: Snapshot, *, has_fault: bool) -> bool:
        if not has_fault:
            self._fault_since_s = self._unnumbered_s = None
        elif self._fault_since_s is None:
            self._fault_since_s = snapshot.readings[FAULT].at_s
        number = snapshot.readings.get(FAULT_CODE)
        if number is None or number.at_s is None or self._fault_since_s is None:
            return True
        return number.at_s >= self._fault_since_s

    def _values_before(self, now_s: float) -> Values:
        return [
            {
                "seconds_before": round(now_s - at_s, 3),
                "values": {
                    name: value for name, value in zip(self._points, values, strict=True) if value is not None
                },
            }
            for at_s, values in self._before
        ]
