"""The trips of one motor: from the readings, states and events of its starter to the record of each.

1. Every good reading goes into the ring. A fault is a trip once its event comes: two readings have shown it.
2. The moment of the trip is the first reading that showed the fault, on the steady clock: no step of the
   wall clock moves it.
3. The record waits for what is read of the starter after the trip (`note_fault_data`), for the fault's
   number and for `AFTER_S` of readings; no longer than `LATEST_S`.
4. Another trip while one waits finishes the first one as it is.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from gateway.contract import EventCode, EventRecord, ReadingTable, Record, TripRecord, stored
from gateway.plugins.history.delivery import Delivery, Part, Past, Rows
from gateway.plugins.history.ring import ReadingRing
from gateway.starters import Readings, StarterSetup
from gateway.store import HistoryRow

KIND = "trip"  # of the rows on disk
STORED = 100  # of each starter
AFTER_S = 2.0  # of readings that follow the trip
LATEST_S = 15.0  # after which it is published with what is known
SLACK_S = 0.1  # a timer may run out early
MOST_BYTES = 16 * 1024  # of the JSON of a record
ALWAYS_S = 10.0  # before the trip: what is nearer is thinned last
NOTHING = ReadingTable((), {}, {})
FAULT = "fault"  # the point; also the alarm as long as its number is not known


@dataclass(slots=True)
class _OpenTrip:
    trip: TripRecord
    at_s: float  # the trip
    seen_s: float  # when its event came
    is_read: bool = False  # what the starter says of it has come


class MotorTrips(Part):
    """Records the trip under way; earlier ones stay on the disk."""

    def __init__(self, setup: StarterSetup, delivery: Delivery, count: Callable[[TripRecord], None]) -> None:
        self._delivery = delivery
        self._count = count
        self._clock = delivery.records.clock
        self._open: _OpenTrip | None = None
        self.reconfigure(setup)

    def take_readings(self, readings: Readings) -> None:
        """Put what was just read into the ring."""
        self._ring.note(readings.values, at_s=readings.at_s)
        self._look()

    def put(self, record: Record) -> None:
        """Begin a record at a fault; remember which faults are active."""
        match record:
            case EventRecord(code=EventCode.ALARM, data={"severity": "fault", "alarm": str(code)}):
                self._active[code] = record.text
                if self._open is not None and self._open.trip.code == FAULT != code:
                    self._open.trip = replace(self._open.trip, code=code, text=record.text)
            case EventRecord(code=EventCode.CLEARED, data={"severity": "fault", "alarm": str(code)}):
                self._active.pop(code, None)
            case EventRecord(code=EventCode.FAULT):
                self._begin(record)
            case _:
                pass

    def note_fault_data(self, at_fault: Rows, history: Sequence[Rows]) -> None:
        """Add what was read of the starter after the trip; empty where it gives or answers nothing."""
        if self._open is not None:
            self._open.trip = replace(self._open.trip, at_fault=dict(at_fault), fault_history=tuple(history))
            self._open.is_read = True
            self._look()

    def restore(self, past: Past) -> None:
        """Count and store the trips that earlier runs only had for the broker."""
        for trip in past.trips:
            self._keep(trip)

    def reconfigure(self, setup: StarterSetup) -> None:
        """Finish the trip under way, and begin with an empty ring."""
        self.close()
        self._has_numbers = bool(setup.profile.alarm_points)
        self._ring = ReadingRing()
        self._active: dict[str, str] = {}  # fault alarms by code: what they mean

    def close(self) -> None:
        """Publish the trip under way as far as it is known."""
        found, self._open = self._open, None
        if found is not None:
            trip = fitted(replace(found.trip, readings=self._ring.around(found.at_s)))
            self._delivery.publish(trip, partial(self._keep, trip))

    def _begin(self, event: EventRecord) -> None:
        """Begin a record; the event has no alarm where the fault has no number, or none yet."""
        self.close()
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
        now_s, began_s = self._clock.now_s(), self._ring.began_s(FAULT)
        self._open = _OpenTrip(trip, now_s if began_s is None else began_s, now_s)
        for after_s in (AFTER_S, LATEST_S):
            asyncio.get_running_loop().call_later(after_s + SLACK_S, self._look)

    def _look(self) -> None:
        """Publish the trip under way once it is whole, or has waited long enough."""
        found, now_s = self._open, self._clock.now_s()
        if found is None or now_s < found.seen_s + AFTER_S:
            return
        is_whole = found.is_read and (found.trip.code != FAULT or not self._has_numbers)
        if is_whole or now_s >= found.seen_s + LATEST_S:
            self.close()

    def _keep(self, trip: TripRecord) -> None:
        self._count(trip)
        row = HistoryRow(trip.starter, KIND, trip.id, stored(trip), STORED)
        self._delivery.store.put(row, is_urgent=True)


def fitted(trip: TripRecord) -> TripRecord:
    """Return the trip thinned so that its JSON has at most `MOST_BYTES`.

    Every other moment goes that is older than `ALWAYS_S` before the trip, again and again; then every other
    one of the others, but the trip's own and the first and the last.
    """
    count = len(trip.readings.t_s)
    while len(trip.payload()) > MOST_BYTES:
        t_s, points = trip.readings.t_s, trip.readings.points
        old = [row for row, at_s in enumerate(t_s) if at_s < -ALWAYS_S]
        gone = {*(old or [row for row, at_s in enumerate(t_s) if at_s][1:-1])[::2]}
        if not gone:
            break
        left = [row for row in range(len(t_s)) if row not in gone]
        columns = {name: tuple(column[row] for row in left) for name, column in points.items()}
        table = ReadingTable(tuple(t_s[row] for row in left), columns, trip.readings.constant)
        text = f"{len(left)} of {count} moments are left, those before the trip were thinned first"
        trip = replace(trip, readings=table, thinned=text)
    return trip
