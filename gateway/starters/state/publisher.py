"""Publishes one starter: events and availability at once, state and values when they are due.

The next look at the starter is asked for when the next thing is due. All timers run out on ticks, so that the
loop wakes up once for many starters.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any

from pydantic import TypeAdapter

from gateway.contract import (
    AlarmRecord,
    InfoRecord,
    LockRecord,
    Record,
    RecordWriter,
    StateRecord,
    ValueRecord,
)
from gateway.families import Profile, once_per_profile
from gateway.starters.state.alarms import AlarmStatus
from gateway.starters.state.decoding import deadbands_of, flags_of
from gateway.starters.state.publication import STATE_EVERY_S, TICK_S, Published, due_values
from gateway.starters.state.readings import good_values
from gateway.starters.state.settled import FirstSeen
from gateway.starters.state.starter_state import Happening, Happenings, StarterState
from gateway.store import Documents

FAULTS = TypeAdapter(dict[str, tuple[str, ...]])  # codes by starter
LASTING_S = 3.0

LockOf = Callable[[str], LockRecord | None]


class StatePublisher:
    """Publishes one starter; `look` is called when it is time to look again."""

    def __init__(
        self,
        starter: str,
        records: RecordWriter,
        profile: Profile,
        *,
        faults: PublishedFaults,
        lock_of: LockOf,
        refresh_s: float,
        look: Callable[[], None],
    ) -> None:
        self._starter = starter
        self._records = records
        self._lock_of = lock_of
        self._refresh_s = refresh_s  # after which unchanged values are published again
        self.is_closed = False
        self._deadbands = deadbands_of(profile)
        self._status_flags = _status_flags(profile)
        self._faults = faults
        self._published = Published()
        self._info: InfoRecord | None = None
        self._look = look
        self._timer: asyncio.TimerHandle | None = None

    def info(self, info: InfoRecord) -> None:
        """Publish what the starter is, when that is news."""
        if info != self._info:
            self._info = info
            self._records.put(info)

    def publish(
        self, state: StarterState, happenings: Happenings, *, now_s: float, reason: str, look_s: float
    ) -> None:
        """Publish what is due of a state and what has happened; look again at `look_s` at the latest.

        `reason` says why nothing is said of a starter.
        """
        is_new = self.publish_status(state, now_s=now_s, reason=reason)
        for happening in happenings:
            self._records.put(
                self._alarm(happening) if isinstance(happening, AlarmStatus) else self._dated(happening)
            )
        published = self._published
        if state.points is not published.points or now_s >= published.next_due_s:
            self.publish_values(state, now_s=now_s)
        if is_new or happenings:
            faults = state.published_faults
            if faults is not None:
                self._faults.note(self._starter, faults)
        self._look_at(min(self._published.next_due_s, state.due_s, look_s))

    def publish_status(self, state: StarterState, *, now_s: float, reason: str) -> bool:
        """Publish the state, its booleans and the starter's lock if that is due; return whether it was."""
        status, times, before = state.status, state.times, self._published
        is_same = (status is before.status or status == before.status) and reason == before.reason
        if is_same and now_s < before.status_s + STATE_EVERY_S:
            return False
        self._published = before._replace(status=status, reason=reason, status_s=now_s)
        self._records.put(
            StateRecord(
                starter=self._starter,
                state=status.word,
                quality=status.quality,
                time_s=min([times[n].time_s for n in self._status_flags if n in times], default=None),
                seq=next(self._records.sequence),
                boot=self._records.boot,
                flags=status.flags,
                lock=self._lock_of(self._starter),
                reason=reason,
                fault_code=status.number,
            )
        )
        return True

    def publish_values(self, state: StarterState, *, now_s: float) -> None:
        """Publish the values that are due."""
        self._published, values = due_values(
            self._published, state, self._deadbands, now_s=now_s, refresh_s=self._refresh_s
        )
        put, boot, sequence = self._records.put, self._records.boot, self._records.sequence
        for point, reading in values.items():
            read = state.times.get(point)
            put(
                ValueRecord(
                    starter=self._starter,
                    point=point,
                    value=reading.value,
                    unit=reading.unit,
                    quality=reading.quality,
                    time_s=None if read is None else read.time_s,
                    seq=next(sequence),
                    boot=boot,
                    label=reading.label,
                    reason=reading.reason,
                )
            )

    def expire(self) -> bool:
        """Have the state published again by the next look; return whether it ever was."""
        self._published = self._published._replace(status_s=-math.inf)
        return self._published.status is not None

    def set_refresh(self, refresh_s: float) -> None:
        """Publish unchanged values again this long after they were sent, from now on."""
        self._refresh_s = refresh_s
        self._published = self._published._replace(refresh_at_s=-math.inf)  # counted again by the next look

    def close(self) -> None:
        """Stop looking by itself."""
        self.is_closed = True
        if self._timer is not None:
            self._timer.cancel()

    def _look_at(self, due_s: float) -> None:
        """Look again at the tick after this time; an earlier timer stays, since most looks are put off."""
        timer, loop = self._timer, asyncio.get_running_loop()
        if due_s == math.inf or (timer is not None and timer.when() <= due_s):
            return
        tick_s = math.ceil(max(due_s, loop.time()) / TICK_S) * TICK_S
        if timer is not None and timer.when() <= tick_s:
            return
        if timer is not None:
            timer.cancel()
        self._timer = loop.call_at(tick_s, self._run)

    def _run(self) -> None:
        self._timer = None
        self._look()

    def _alarm(self, known: AlarmStatus) -> AlarmRecord:
        return AlarmRecord(
            starter=self._starter,
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

    def _dated(self, happening: Happening) -> Record:
        """Return an event, with the values before it."""
        event, first = happening.event, happening.first
        if first is not None:
            event = event._replace(data={**event.data, "before": _before(first)})
        return self._records.dated(self._starter, event, time_s=happening.time_s)


class PublishedFaults:
    """The standing faults of all starters whose events were published, also by an earlier run.

    The document is saved `LASTING_S` after a change: the event is on the disk long before, so that it is not
    lost by being counted as published. After a kill before that, the next run publishes it once more.
    """

    def __init__(self, documents: Documents) -> None:
        self._document = documents.open("faults", FAULTS, lambda: self._codes, delay_s=LASTING_S)
        self._codes = self._document.loaded or {}

    def of(self, starter: str) -> tuple[str, ...]:
        """Return the codes of the fault that was published; empty for none."""
        return self._codes.get(starter, ())

    def note(self, starter: str, codes: tuple[str, ...]) -> None:
        """Record the fault that stands and was published; empty when there is none."""
        if self.of(starter) != codes:
            self._codes[starter] = codes
            self._document.touch()


@once_per_profile
def _status_flags(profile: Profile) -> tuple[str, ...]:
    """Return the booleans of the status, by which the state is dated."""
    return tuple(name for name in flags_of(profile) if profile.points[name].group == "status")


def _before(first: FirstSeen) -> list[dict[str, Any]]:
    """Return the values that were good before an event, the oldest first."""
    found: list[dict[str, Any]] = []
    for then in first.earlier:
        good = good_values(then.points)
        if good:
            found.append({"seconds_before": round(first.now_s - then.at_s, 3), "values": good})
    return found
