"""The part of a starter's history that records its trips."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from typing import Any

from gateway.contract import EventCode, EventRecord, Record, TripRecord, rfc3339
from gateway.plugins.history.service.part import HistoryPart, Surroundings
from gateway.plugins.history.trip_record import STORED, TripSnapshot
from gateway.plugins.history.trip_recorder import AFTER_S, LATEST_S, TripRecorder
from gateway.starters.setup import StarterSetup
from gateway.starters.telemetry.readings import Readings

KIND = "trip"  # of the rows on disk
SLACK_S = 0.1  # a timer may run out early


class TripPart(HistoryPart):
    """Records the trip under way; earlier ones stay on the disk."""

    def __init__(self, setup: StarterSetup, here: Surroundings) -> None:
        super().__init__(setup, here)
        self._recorder = _recorder(setup)
        self._timers: tuple[asyncio.TimerHandle, ...] = ()

    def take_readings(self, readings: Readings) -> None:
        """Put what was just read into the ring."""
        self._recorder.ring.note(readings.values, at_s=readings.at_s)
        self._look()

    def take_record(self, record: Record) -> None:
        """Begin a record at a fault; remember which faults are active."""
        if not isinstance(record, EventRecord):
            return
        if record.code in (EventCode.ALARM, EventCode.CLEARED) and record.data.get("severity") == "fault":
            code = str(record.data.get("alarm"))
            self._recorder.note_alarm(code, record.text, is_active=record.code == EventCode.ALARM)
        elif record.code == EventCode.FAULT:
            self._begin(record)

    def note_fault_data(
        self, at_fault: Mapping[str, Mapping[str, Any]], history: Sequence[Mapping[str, Any]]
    ) -> None:
        """Add what was read of the starter after the trip."""
        self._recorder.add_fault_data(at_fault, history)
        self._look()

    def follow(self, setup: StarterSetup) -> None:
        """Finish the trip under way, and begin with an empty ring."""
        self._finish(self._recorder.take())
        self._recorder = _recorder(setup)

    def close(self) -> None:
        """Finish the trip under way."""
        self._finish(self._recorder.take())

    def _begin(self, event: EventRecord) -> None:
        state_before, code = event.data.get("from"), event.data.get("alarm")
        now_s = self._records.clock.now_s()
        unfinished = self._recorder.note_fault(
            id_=f"{self._here.boot}-{event.seq}",
            boot=self._here.boot,
            seq=event.seq,
            time=rfc3339(event.time_s),
            text=event.text,
            state_before=None if state_before is None else str(state_before),
            now_s=now_s,
            code=None if code in (None, "fault") else str(code),
        )
        self._finish(unfinished)
        loop = asyncio.get_running_loop()
        self._timers = tuple(loop.call_later(s + SLACK_S, self._look) for s in (AFTER_S, LATEST_S))

    def _look(self) -> None:
        if self._recorder.is_waiting:
            self._finish(self._recorder.take_due(self._records.clock.now_s()))

    def _finish(self, trip: TripSnapshot | None) -> None:
        if trip is None:
            return
        for timer in self._timers:
            timer.cancel()
        data = trip.to_dict()
        self._records.put(
            TripRecord(starter=self._name, id=trip.id, data=data)
        )  # counted by that: one transaction
        self._put(KIND, trip.id, data, limit=STORED, is_urgent=True)


def _recorder(setup: StarterSetup) -> TripRecorder:
    return TripRecorder(has_numbers=bool(setup.profile.alarm_points))
