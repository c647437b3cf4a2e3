"""The state of a starter with its alarms, and the events that follow from them; published at once."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Any

from gateway.families.schema import Profile
from gateway.families.state import alarms_of, state_of
from gateway.starters.alarms import AlarmBook, Standing
from gateway.starters.changes import UNKNOWN, Change, Watch
from gateway.starters.decoding import is_flag
from gateway.starters.publisher import Publisher
from gateway.starters.records import Quality, Severity
from gateway.starters.report import LATEST_S
from gateway.starters.snapshot import Reading, Snapshot, Value, as_flag, good_values

MOMENTS_BEFORE = 3  # sets of values that an event carries from before it
FAULT, FAULT_CODE = "fault", "fault_code"
SUMMARY_FLAGS = (FAULT, "alarm")  # decide whether the alarms can be told at all


class Status:
    """Tells the state of one starter whenever it changes, and at the latest every 30 s."""

    def __init__(self, profile: Profile, publisher: Publisher) -> None:
        self._profile = profile
        self._publisher = publisher
        self._flags = tuple(name for name in profile.points if is_flag(profile, name))
        self._summary_flags = tuple(name for name in SUMMARY_FLAGS if name in profile.points)
        self._watch = Watch()
        self._alarms = AlarmBook()
        self._before: deque[tuple[float, dict[str, Reading]]] = deque(maxlen=MOMENTS_BEFORE)
        self._fault_since_s: float | None = None  # steady clock, when the present fault was seen first
        self._sent: tuple[str, Quality, dict[str, Value]] | None = None
        self._sent_s = -math.inf
        self._standing = -1  # of the snapshot that was told last

    @property
    def next_due_s(self) -> float:
        """Return when the state is published again although nothing changed."""
        return self._sent_s + LATEST_S

    def remember(self, snapshot: Snapshot, *, now_s: float) -> None:
        """Keep the present values: they may become those before an event. Call before a status is applied."""
        if snapshot.has_good():
            self._before.append((now_s, dict(snapshot.readings)))

    def tell(self, snapshot: Snapshot, *, now_s: float, utc_s: float) -> str:
        """Publish what a snapshot says and return the state; where nothing is new this costs nothing."""
        has_fault = self._fault_since_s is not None  # then it matters when its number was read
        if self._sent and snapshot.standing == self._standing and now_s < self.next_due_s and not has_fault:
            return self._sent[0]
        self._standing = snapshot.standing
        values = snapshot.good_values()
        state = state_of(self._profile, values)
        changes = self._watch.note(state, remote=as_flag(values.get("remote")), time_s=utc_s)
        self._tell_state(state, values, snapshot, now_s=now_s)
        self._tell_alarms(snapshot, values, utc_s=utc_s)
        for change in changes:
            self._publisher.change(change, time_s=utc_s, more=self._values_before(now_s))
        return state

    def _tell_state(
        self, state: str, values: Mapping[str, Value], snapshot: Snapshot, *, now_s: float
    ) -> None:
        flags = {name: values.get(name) for name in self._flags}
        quality = self._quality(state, snapshot)
        said = (state, quality, flags)
        if said == self._sent and now_s < self.next_due_s:
            return
        times = [snapshot.readings[name].time_s for name in self._flags]
        known = [time_s for time_s in times if time_s is not None]
        self._publisher.state(state, quality=quality, time_s=max(known, default=None), flags=flags)
        self._sent, self._sent_s = said, now_s

    def _quality(self, state: str, snapshot: Snapshot) -> Quality:
        if state != UNKNOWN:
            return Quality.GOOD
        is_lost = any(snapshot.readings[name].quality is Quality.STALE for name in self._flags)
        return Quality.STALE if is_lost else Quality.BAD

    def _tell_alarms(self, snapshot: Snapshot, values: Mapping[str, Value], *, utc_s: float) -> None:
        """Publish the alarms that came or went; nothing can be said while a summary flag is not known."""
        if any(name not in values for name in self._summary_flags):
            return
        shown = {name: known.value for name, known in snapshot.readings.items()}  # numbers may be older,
        if not self._is_number_of_this_fault(snapshot, has_fault=bool(values.get(FAULT))):
            shown[FAULT_CODE] = (
                None  # but not from before this fault (ssw07 P014: the last fault, active or not)
            )
        changed = self._alarms.update(alarms_of(self._profile, shown), time_s=utc_s)
        came = {standing.alarm.severity for standing in changed if standing.is_active}
        for standing in changed:
            self._publisher.alarm(standing)
            is_superseded = not standing.is_active and standing.alarm.severity in came
            if not is_superseded:
                self._publisher.change(_alarm_change(standing), time_s=utc_s)

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


def _alarm_change(standing: Standing) -> Change:
    alarm = standing.alarm
    data = {"alarm": alarm.code, "severity": alarm.severity, "count": standing.count}
    if standing.is_active:
        severity = Severity.ERROR if alarm.severity == "fault" else Severity.WARNING
        return Change("alarm", severity, alarm.text, data)
    return Change("cleared", Severity.INFO, f"cleared: {alarm.text}", data)
