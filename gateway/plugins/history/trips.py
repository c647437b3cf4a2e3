"""The trips of one motor: each is recorded, stored and published."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from gateway.contract import EventCode, EventRecord, Record, TripRecord
from gateway.plugins.history.delivery import Delivery, Part, Past
from gateway.plugins.history.trip_recorder import AFTER_S, LATEST_S, TripRecorder
from gateway.starters import Readings, StarterSetup
from gateway.store import HistoryRow

KIND = "trip"  # of the rows on disk
STORED = 100  # of each starter
SLACK_S = 0.1  # a timer may run out early


class MotorTrips(Part):
    """Records the trip under way; earlier ones stay on the disk."""

    def __init__(self, setup: StarterSetup, delivery: Delivery, count: Callable[[TripRecord], None]) -> None:
        self._delivery = delivery
        self._count = count
        self._clock = delivery.records.clock
        self._recorder = _recorder_of(setup)

    def take_readings(self, readings: Readings) -> None:
        """Put what was just read into the ring."""
        self._recorder.ring.note(readings.values, at_s=readings.at_s)
        self._look()

    def put(self, record: Record) -> None:
        """Begin a record at a fault; remember which faults are active."""
        if not isinstance(record, EventRecord):
            return
        if record.code in (EventCode.ALARM, EventCode.CLEARED) and record.data.get("severity") == "fault":
            code = str(record.data.get("alarm"))
            self._recorder.note_alarm(code, record.text, is_active=record.code == EventCode.ALARM)
        elif record.code == EventCode.FAULT:
            self._finish(self._recorder.note_fault(record, now_s=self._clock.now_s()))
            for after_s in (AFTER_S, LATEST_S):
                asyncio.get_running_loop().call_later(after_s + SLACK_S, self._look)

    def note_fault_data(
        self, at_fault: Mapping[str, Mapping[str, Any]], history: Sequence[Mapping[str, Any]]
    ) -> None:
        """Add what was read of the starter after the trip."""
        self._recorder.add_fault_data(at_fault, history)
        self._look()

    def restore(self, past: Past) -> None:
        """Count and store the trips that earlier runs only had for the broker."""
        for trip in past.trips:
            self._keep(trip)

    def reconfigure(self, setup: StarterSetup) -> None:
        """Finish the trip under way, and begin with an empty ring."""
        self.close()
        self._recorder = _recorder_of(setup)

    def close(self) -> None:
        """Finish the trip under way."""
        self._finish(self._recorder.take())

    def _look(self) -> None:
        if self._recorder.is_waiting:
            self._finish(self._recorder.take_due(self._clock.now_s()))

    def _finish(self, trip: TripRecord | None) -> None:
        if trip is not None:
            self._delivery.publish(trip, partial(self._keep, trip))

    def _keep(self, trip: TripRecord) -> None:
        self._count(trip)
        row = HistoryRow(trip.starter, KIND, trip.id, trip.fields(), STORED)
        self._delivery.store.put(row, is_urgent=True)


def _recorder_of(setup: StarterSetup) -> TripRecorder:
    return TripRecorder(has_numbers=bool(setup.profile.alarm_points))
