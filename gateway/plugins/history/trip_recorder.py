"""From the readings, states and events of one starter to the record of each trip.

1. Every good reading goes into the ring. A fault is a trip once its event comes: two readings have shown it.
2. The moment of the trip is the first reading that showed the fault, on the steady clock: no step of the
   wall clock moves it.
3. The record waits for what is read of the starter after the trip (`add_fault_data`), for the fault's
   number and for `AFTER_S` of readings; no longer than `LATEST_S`.
4. Another trip while one waits finishes the first one as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from gateway.contract import EventRecord, ReadingTable, TripRecord
from gateway.plugins.history.ring import ReadingRing, without

AFTER_S = 2.0  # of readings that follow the trip
LATEST_S = 15.0  # after which it is published with what is known
MOST_BYTES = 16 * 1024  # of the JSON of a record
ALWAYS_S = 10.0  # before the trip: what is nearer is thinned last
NOTHING = ReadingTable((), {}, {})
FAULT = "fault"  # the point; also the alarm as long as its number is not known


@dataclass(slots=True)
class _OpenTrip:
    trip: TripRecord
    at_s: float  # the trip
    due_s: float  # the earliest
    latest_s: float
    is_read: bool = False


@dataclass(slots=True)
class TripRecorder:
    """The trips of one starter; `now_s` is on the steady clock."""

    has_numbers: bool = True  # the family numbers its faults: a record waits for the number
    ring: ReadingRing = field(default_factory=ReadingRing)
    _active: dict[str, str] = field(default_factory=dict)  # fault alarms by code: what they mean
    _pending: _OpenTrip | None = None

    @property
    def is_waiting(self) -> bool:
        """Return whether a trip is under way."""
        return self._pending is not None

    def note_alarm(self, code: str, text: str, *, is_active: bool) -> None:
        """Record that a fault with this code has come or gone; two readings have shown it."""
        if not is_active:
            self._active.pop(code, None)
            return
        self._active[code] = text
        pending = self._pending
        if pending is not None and pending.trip.code == FAULT and code != FAULT:
            pending.trip = replace(pending.trip, code=code, text=text)

    def note_fault(self, event: EventRecord, *, now_s: float) -> TripRecord | None:
        """Begin the record of a trip; return the one that was under way until now, if any.

        The event has no alarm where the fault's number is not known yet, or the family has none.
        """
        unfinished = self.take()
        state_before, code, text = event.data.get("from"), event.data.get("alarm"), event.text
        if code in (None, FAULT):
            code = next((active for active in self._active if active != FAULT), FAULT)
            text = self._active.get(code, text)
        trip = TripRecord(
            starter=event.starter,
            id=f"{event.boot}-{event.seq}",
            time_s=event.time_s,
            boot=event.boot,
            seq=event.seq,
            code=str(code),
            text=text,
            state_before=None if state_before is None else str(state_before),
            readings=NOTHING,
            at_fault={},
            fault_history=(),
        )
        began_s = self.ring.began_s(FAULT)
        at_s = now_s if began_s is None else began_s
        self._pending = _OpenTrip(trip, at_s, now_s + AFTER_S, now_s + LATEST_S)
        return unfinished

    def add_fault_data(
        self, at_fault: Mapping[str, Mapping[str, Any]], history: Sequence[Mapping[str, Any]]
    ) -> None:
        """Add what was read of the starter after the trip; empty where it gives or answers nothing."""
        if self._pending is not None:
            trip = self._pending.trip
            self._pending.trip = replace(trip, at_fault=dict(at_fault), fault_history=tuple(history))
            self._pending.is_read = True

    def take_due(self, now_s: float) -> TripRecord | None:
        """Return the record that is finished now; None while there is nothing to publish."""
        pending = self._pending
        if pending is None or now_s < pending.due_s:
            return None
        is_whole = pending.is_read and (pending.trip.code != FAULT or not self.has_numbers)
        return self.take() if is_whole or now_s >= pending.latest_s else None

    def take(self) -> TripRecord | None:
        """Return the trip under way as far as it is known, and forget it; None when there is none."""
        pending, self._pending = self._pending, None
        if pending is None:
            return None
        return fitted(replace(pending.trip, readings=self.ring.around(pending.at_s)))


def fitted(trip: TripRecord) -> TripRecord:
    """Return the trip so that its JSON has at most `MOST_BYTES`.

    Every other moment goes that is older than `ALWAYS_S` before the trip, again and again; then every other
    one of what is left; then the starter's own rows, the last ones first.
    """
    count = len(trip.readings.t_s)
    while len(trip.payload()) > MOST_BYTES:
        rows = _dispensable(trip.readings)
        if rows:
            left = without(trip.readings, rows)
            text = f"{len(left.t_s)} of {count} moments are left, those before the trip were thinned first"
            trip = replace(trip, readings=left, thinned=text)
        elif trip.fault_history:
            trip = replace(trip, fault_history=trip.fault_history[:-1])
        elif trip.at_fault:
            trip = replace(trip, at_fault=dict(list(trip.at_fault.items())[:-1]))
        else:
            return replace(trip, readings=NOTHING, text=trip.text[:200])
    return trip


def _dispensable(table: ReadingTable) -> set[int]:
    """Return which rows go next; none when only two are left."""
    old = [row for row, t_s in enumerate(table.t_s) if t_s < -ALWAYS_S]
    if old:
        return set(old[::2])
    near = [row for row, t_s in enumerate(table.t_s) if t_s != 0.0][1:-1]
    return set(near[::2])
