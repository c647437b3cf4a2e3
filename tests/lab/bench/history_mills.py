"""Many SSW900 whose history is recorded, as fast as that goes: virtual time, no line."""

from __future__ import annotations

import functools
import itertools
import random
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from gateway.app.history import HistoryService
from gateway.history.readings import Readings
from gateway.records import EventRecord, Record, RecordWriter, Severity, StartRecord, TripRecord
from gateway.storage.history import HistoryStore
from gateway.system.clock_steps import ClockReading
from tests.history.support import AnalyticStart, ReadMotor
from tests.plant_rig import setups, site

STARTS = 20  # different ones, again and again
FAST_S = 0.25
COASTS_S = 2.5  # from a trip until its record is due


@dataclass
class SetClock:
    """A clock that shows what it is set to."""

    at_s: float = 0.0
    epoch_s: float = 1_760_000_000.0

    def now_s(self) -> float:
        return self.at_s

    def utc_s(self, at_s: float | None = None) -> float:
        return self.epoch_s + (self.at_s if at_s is None else at_s)

    def reading(self) -> ClockReading:
        raise NotImplementedError


@dataclass
class Count:
    """A broker that acknowledges everything at once, and only counts."""

    starts: int = 0
    trips: int = 0
    values: dict[tuple[str, str], Any] = field(default_factory=dict)
    delivered: Callable[[str], None] = lambda _: None

    def put(self, record: Record) -> None:
        self.starts += isinstance(record, StartRecord)
        self.trips += isinstance(record, TripRecord)
        if isinstance(record, StartRecord | TripRecord):
            self.delivered(record.key)
        point = getattr(record, "point", None)
        if point is not None:
            self.values[record.starter, point] = record.value  # type: ignore[union-attr] # a value has them


class Mills:
    """Many SSW900 with all parts of their history, whose replies hold every point of the family."""

    def __init__(self, file: HistoryStore, count: int) -> None:
        self.clock, self.sink = SetClock(), Count()
        self._records = RecordWriter(self.sink, self.clock)
        mill = next(setup for setup in setups(site()) if setup.profile.family == "ssw900")
        self.names = [f"mill-{n}" for n in range(count)]
        self.service = HistoryService(
            Path(),
            [replace(mill, name=name) for name in self.names],
            boot="0123456789abcdef",
            records=self._records,
            publish_event=lambda *_: None,
            make_file=lambda *_: file,
        )
        self.sink.delivered = self.service.delivered
        self._at_fault = _rows(mill.profile.history.at_fault)
        self._replies = [_replies(seed) for seed in range(STARTS)]
        self._seeds = itertools.count()

    async def begin(self) -> None:
        """Read what is stored; the file is begun."""
        self.service.start()
        await self.service.loaded()

    def start(self, name: str) -> None:
        """Let one motor start now, and run on for some seconds."""
        began_s = self.clock.at_s
        for each in self._replies[next(self._seeds) % STARTS]:
            self._take(name, each, began_s)
        self.service.note_own_rows(name, {"D6.2": round(began_s / 7200, 1), "S4.2.1": 40.0})
        self.clock.at_s = began_s

    def trip(self, name: str) -> None:
        """Let one motor trip that has just been started."""
        began_s = self.clock.at_s
        last = self._replies[(next(self._seeds) - 1) % STARTS][-1]
        tripped = {**last.values, "running": False, "full_voltage": False, "fault": True, "fault_code": 77}
        shown = last._replace(state="fault", values=tripped)
        self._take(name, shown, began_s)
        text = "Motor thermal class (overload)"
        for code, data in (
            ("alarm", {"alarm": "f077", "severity": "fault"}),
            ("fault", {"from": "running", "alarm": "f077"}),
        ):
            seq, utc_s = self._records.sequence.take(), self.clock.utc_s()
            self.service.put(EventRecord(name, code, Severity.ERROR, text, utc_s, seq, data))
        self.service.note_fault_data(name, self._at_fault, ())
        for step in range(1, int(COASTS_S / FAST_S) + 1):
            self._take(name, shown._replace(at_s=last.at_s + step * FAST_S), began_s)
        utc_s, seq = self.clock.utc_s(), self._records.sequence.take()
        data = {"alarm": "f077", "severity": "fault"}
        self.service.put(EventRecord(name, "cleared", Severity.INFO, "", utc_s, seq, data))
        self.clock.at_s = began_s

    def _take(self, name: str, readings: Readings, began_s: float) -> None:
        self.clock.at_s = at_s = began_s + readings.at_s
        self.service.take_readings(name, readings._replace(at_s=at_s, time_s=self.clock.utc_s()))


def _rows(codes: tuple[str, ...]) -> Mapping[str, Mapping[str, Any]]:
    dice = random.Random(0)
    return {
        code: {"value": round(dice.uniform(1, 900), 1), "unit": "A", "name": f"Name of the row {code}"}
        for code in codes
    }


@functools.cache
def _replies(seed: int) -> tuple[Readings, ...]:
    """Return what is read of a start; the same for all rigs of a process."""
    return tuple(_read(seed))


def _read(seed: int) -> Iterator[Readings]:
    dice = random.Random(seed)
    motor = ReadMotor(AnalyticStart(10.0, 10.0), fast_s=FAST_S, seed=seed, noise=0.004, is_ours=True)
    flags = dict.fromkeys(
        ("general_enabled", "jog", "decelerating", "braking", "reversing", "reverse", "alarm"), False
    ) | dict.fromkeys(("s5_2_5", "s5_2_6", "fault_code", "d2_1_1", "d2_1_2", "d2_1_3"), 0)
    for readings in motor.replies(0.0, 27.0):
        current = readings.values.get("current")
        if not isinstance(current, float):
            yield readings._replace(values={**readings.values, **flags})
            continue
        more = {
            "current_pct": round(current / 0.85, 1),
            "line_voltage": round(dice.gauss(396.0, 1.0), 1),
            "output_voltage": round(dice.uniform(100.0, 400.0), 1),
            "torque_pct": round(dice.uniform(20.0, 160.0), 1),
            "power_factor": round(dice.uniform(0.3, 0.9), 2),
            "active_power": round(dice.uniform(10.0, 90.0), 1),
            "apparent_power": round(dice.uniform(10.0, 90.0), 1),
            "reactive_power": round(dice.uniform(10.0, 90.0), 1),
            "line_frequency": round(dice.gauss(50.0, 0.02), 1),
            "heatsink_temperature": round(dice.gauss(40.0, 0.5), 1),
            "s4_2_1": round(dice.gauss(40.0, 0.5), 1),
        }
        yield readings._replace(values={**readings.values, **more})
