"""The sums in the life of one motor: hours, hours by load, energy, starts, trips.

1. Time counts between two readings of the status, both good, in the state of the first one; all times are on
   the steady clock, so a step of the wall clock adds nothing. Between a reading and a silence nothing counts.
2. The load is what was read last of `current_pct`, or of `current` where the rated current is known.
3. Energy is the trapezoid between two good readings of `active_power`.
4. The starter's own counters win: ours are published only where it has none.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import Field, PlainSerializer

from gateway.contract import read_stored
from gateway.plugins.history.limits import NOTHING, Learnt
from gateway.starters import Readings

KIND = "counters"  # of the row on disk
LEAST_GAP_S = 30.0  # between two readings, up to which what lies between counts at any period
GAP_PERIODS = 4  # of the status; the same of the slowest values, which have `SLOW` times its period
SLOW = 10
STATUS_POINT = "running"  # every family has it, and reads it with the status
OPERATING = frozenset({"starting", "running", "stopping"})
STANDING = frozenset({"ready", "not_ready", "fault"})
BANDS_PCT = {"low": 50.0, "normal": 90.0, "high": 120.0, "over": math.inf}  # of rated current, up to
MOST_CODES = 64  # trips by code: fewer faults than a family has
HOUR_S = 3600.0


def _rounded(digits: int) -> PlainSerializer:
    return PlainSerializer(lambda amount: round(amount, digits))


Seconds = Annotated[float, Field(ge=0, allow_inf_nan=False), _rounded(1)]
Count = Annotated[int, Field(ge=0)]


@dataclass(slots=True)
class Totals:
    """The sums themselves, as they are stored. Times in seconds."""

    operating_s: Seconds = 0.0
    bands_s: dict[str, Seconds] = field(default_factory=lambda: dict.fromkeys(BANDS_PCT, 0.0))
    energy_kwh: Annotated[float, Field(ge=0, allow_inf_nan=False), _rounded(4)] = 0.0
    starts: Count = 0
    trips: Counter[str] = field(default_factory=Counter)

    def add(self, other: Totals) -> None:
        """Add what was counted before."""
        self.operating_s += other.operating_s
        for name in self.bands_s:
            self.bands_s[name] += other.bands_s.get(name, 0.0)
        self.energy_kwh += other.energy_kwh
        self.starts += other.starts
        self.trips += other.trips


@dataclass(slots=True)
class CountersRow:
    """The stored counters of one motor."""

    totals: Totals = field(default_factory=Totals)
    thermal: Learnt = NOTHING


def counted(rows: Iterable[Mapping[str, Any]]) -> CountersRow:
    """Return what the rows of a motor say together; what is no count is as good as missing.

    There is one, but for a run of 0.2.0 that could not read the disk: it had another, to be added.
    """
    found = CountersRow()
    for data in rows:
        with suppress(ValueError):
            row = read_stored(CountersRow, data)
            found.totals.add(row.totals)
            found.thermal = found.thermal.with_more(row.thermal.taus_s, row.thermal.heatings)
    return found


class MotorCounters:
    """Counts for one starter; `at_s` is on the steady clock."""

    def __init__(self, totals: Totals | None = None, *, period_s: float = 1.0) -> None:
        self.totals = totals or Totals()
        self.period_s = period_s  # of the status
        self.rated_a: float | None = None  # of the motor or the starter, where nothing gives per cent
        self.has_power = False  # whether power was ever read
        self.has_load = False  # whether the load was ever known
        self.state = "unknown"
        self._status_s: float | None = None  # of the last reading of the status
        self._power: tuple[float, float] | None = None  # time and kW
        self._load: tuple[float, float] | None = None  # time and per cent

    @property
    def is_seen(self) -> bool:
        """Return whether the state is known now."""
        return self.state in OPERATING | STANDING

    def note_state(self, state: str) -> None:
        """Record the state from now on; a state that is not known means that nothing is seen any more."""
        self.state = state
        if not self.is_seen:
            self._status_s = self._power = self._load = None

    def note_readings(self, readings: Readings) -> None:
        """Count what has passed since the readings before."""
        power, load, at_s = readings.number("active_power"), self._load_of(readings), readings.at_s
        if STATUS_POINT in readings.values:
            self._count_time(at_s)
        if load is not None:
            self._load = (at_s, load)
            self.has_load = True
        if power is not None:
            self._count_energy(at_s, power)

    def note_start(self) -> None:
        """Count a start."""
        self.totals.starts += 1

    def note_trip(self, code: str) -> None:
        """Count a trip."""
        trips = self.totals.trips
        trips[code if code in trips or len(trips) < MOST_CODES else "other"] += 1

    def _count_time(self, at_s: float) -> None:
        since_s, self._status_s = self._status_s, at_s
        gap_s = max(LEAST_GAP_S, GAP_PERIODS * self.period_s)
        if since_s is None or not 0 < at_s - since_s <= gap_s or self.state not in OPERATING:
            return
        self.totals.operating_s += at_s - since_s
        if self._load is not None and at_s - self._load[0] <= self._value_gap_s:
            self.totals.bands_s[band_of(self._load[1])] += at_s - since_s

    def _count_energy(self, at_s: float, power_kw: float) -> None:
        before, self._power = self._power, (at_s, power_kw)
        self.has_power = True
        if before is None or not 0 < at_s - before[0] <= self._value_gap_s:
            return
        self.totals.energy_kwh += (before[1] + power_kw) / 2 * (at_s - before[0]) / HOUR_S

    @property
    def _value_gap_s(self) -> float:
        return GAP_PERIODS * SLOW * max(self.period_s, 1.0)

    def _load_of(self, readings: Readings) -> float | None:
        percent = readings.number("current_pct")
        if percent is None and self.rated_a and (current := readings.number("current")) is not None:
            return 100.0 * current / self.rated_a
        return percent


def band_of(load_pct: float) -> str:
    """Return the load band; a limit belongs to the band above it, as in a log of a motor relay."""
    return next(name for name, below in BANDS_PCT.items() if load_pct < below or below == math.inf)
