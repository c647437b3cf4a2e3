"""The counters and limits of one motor, published as values."""

from __future__ import annotations

import math
from collections.abc import Mapping

from gateway.contract import (
    EventCode,
    InfoRecord,
    Quality,
    Record,
    StartRecord,
    StateRecord,
    TripRecord,
    ValueRecord,
    stored,
)
from gateway.plugins.history.counters import (
    HOUR_S,
    KIND,
    STANDING,
    CountersRow,
    MotorCounters,
    Totals,
    counted,
)
from gateway.plugins.history.delivery import Delivery, Part, Past
from gateway.plugins.history.limits import ThermalModel, pause_left_s, starts_left
from gateway.starters import Policy, PublicationPace, Readings, StarterSetup, Value
from gateway.starters import own_points_of as own_points
from gateway.store import HistoryRow

STORE_EVERY_S = 590.0  # what a kill loses at most is ten minutes
LOOK_EVERY_S = 1.0  # between two looks at what is due; a change of state is looked at without delay
OWN_VALID_S = 300.0  # how long a row of the starter counts as read
MINUTE_S = 60.0


class MotorValues(Part):
    """Counts from 0 until it is known what earlier runs have counted, but publishes and stores no sums."""

    def __init__(self, setup: StarterSetup, delivery: Delivery, policy: Policy) -> None:
        self._delivery = delivery
        self._policy = policy
        self._totals = Totals()
        self._is_restored = False
        self._stored_s = self._delivery.records.clock.now_s()
        self._stored = ""  # as a text, which takes less room
        self._good: tuple[float | None, Mapping[str, Value]] = (None, {})  # when, and the values
        self._looked_s = -math.inf
        self._left: int | None = None  # starts, at the last look
        self.reconfigure(setup)

    def reconfigure(self, setup: StarterSetup) -> None:
        """Go on counting: another machine or other polls under the same name drive the same motor."""
        rows = setup.profile.history
        self._setup = setup
        self._counters = MotorCounters(self._totals, period_s=setup.every_s)
        self._thermal = ThermalModel(rows.thermal_trip)  # of a family without a level it never says anything
        self._pace = PublicationPace(own_points(setup.profile))
        self._own: dict[str, tuple[float, float]] = {}  # rows of the starter: when they were read, and what

    def take_readings(self, readings: Readings) -> None:
        """Count what has passed, and publish what is due."""
        level = readings.number(self._setup.profile.thermal_point)
        if level is not None:
            self._note_level(level, readings.at_s)
        before = self._counters.state
        self._counters.note_readings(readings)
        self._note_state(readings.state)
        if before != readings.state == "running":
            self._thermal.note_started()
        if before != readings.state or readings.at_s - self._looked_s >= LOOK_EVERY_S:
            self._publish(readings.at_s, utc_s=readings.time_s)
        if readings.at_s - self._stored_s >= STORE_EVERY_S:
            self._store()

    def put(self, record: Record) -> None:
        """Count starts and trips; publish that values are stale once the state is not known."""
        match record:
            case StateRecord():
                self._note_state(record.state)
                if not self._counters.is_seen:
                    self._publish(self._delivery.records.clock.now_s())
            case StartRecord():
                self._counters.note_start()
                self._store()
                self._publish(self._delivery.records.clock.now_s())
            case TripRecord():
                self._counters.note_trip(record.code)
                self._store()
            case InfoRecord():
                self._counters.rated_a = record.rated_current_a
                self._publish(self._delivery.records.clock.now_s())
            case _:
                pass

    def note_own_rows(self, rows: Mapping[str, float]) -> None:
        """Record what the starter itself has counted, and its settings; by code, just read."""
        now_s, names = self._delivery.records.clock.now_s(), self._setup.profile.history
        self._own |= {code: (now_s, value) for code, value in rows.items()}
        if names.thermal in rows:
            self._note_level(rows[names.thermal], now_s)
        if names.cooling in rows:
            self._thermal.set_tau_s = rows[names.cooling] * MINUTE_S

    def restore(self, past: Past) -> None:
        """Add what earlier runs have counted; once."""
        before = counted(row.data for row in past.rows if row.kind == KIND)
        self._totals.add(before.totals)
        early = self._thermal.learnt
        self._thermal.learnt = before.thermal.with_more(early.taus_s, early.heatings)
        self._is_restored = True
        self._store()

    def close(self) -> None:
        """Store the sums in any case: the file may have been set aside since they changed."""
        self._stored = ""
        self._store()

    def _note_level(self, level: float, at_s: float) -> None:
        self._thermal.note_level(level, at_s=at_s, is_standing=self._counters.state in STANDING)

    def _note_state(self, state: str) -> None:
        before = self._counters.state
        self._counters.note_state(state)
        if not self._counters.is_seen:
            self._thermal.forget()
        elif before in STANDING and state == "starting":
            self._thermal.note_start()

    def _store(self) -> None:
        """Have the sums written if they have changed; before those of earlier runs are known nothing is."""
        if not self._is_restored:
            return
        self._stored_s = self._delivery.records.clock.now_s()
        data = stored(CountersRow(self._totals, self._thermal.learnt))
        if (said := str(data)) != self._stored:
            self._stored = said
            self._delivery.store.put(HistoryRow(self._setup.name, KIND, self._delivery.records.boot, data))

    def _publish(self, now_s: float, *, utc_s: float | None = None) -> None:
        """Publish what is due; good values only while the starter is seen."""
        self._looked_s = now_s
        is_good = self._counters.is_seen
        if is_good:
            self._good = (
                self._delivery.records.clock.utc_s(now_s) if utc_s is None else utc_s,
                self._values(now_s),
            )
        good_utc_s, good = self._good
        for point in self._pace.take_due(good, is_good=is_good, now_s=now_s):
            value = good.get(point.name)
            seq = next(self._delivery.records.sequence)
            self._delivery.records.put(
                ValueRecord(
                    starter=self._setup.name,
                    point=point.name,
                    value=value,
                    unit=point.unit,
                    quality=Quality.BAD if value is None else Quality.GOOD if is_good else Quality.STALE,
                    time_s=None if value is None else good_utc_s,
                    seq=seq,
                    boot=self._delivery.records.boot,
                )
            )

    def _values(self, now_s: float) -> dict[str, Value]:
        return (self._sums(now_s) if self._is_restored else {}) | self._limits(now_s)

    def _sums(self, now_s: float) -> dict[str, Value]:
        totals, has_load = self._totals, self._counters.has_load
        rows = self._setup.profile.history
        trips = sorted(totals.trips.items())
        energy_kwh = round(totals.energy_kwh, 2) if self._counters.has_power else None
        return {
            "hours_total": _hours(self._own_or(rows.hours, totals.operating_s, now_s)),
            "energy_kwh": self._own_or(rows.energy, energy_kwh, now_s),
            "starts_total": totals.starts,
            "trips_total": totals.trips.total(),
            "trips_by_code": " ".join(f"{code}:{count}" for code, count in trips),
            **{f"hours_{name}": _hours(s) if has_load else None for name, s in totals.bands_s.items()},
        }

    def _own_or(self, code: str, ours: float | None, now_s: float) -> float | None:
        """Return the starter's own count; ours where it has or gives none, None while that is not known."""
        own = self._own.get(code)
        if not code or (own is None and self._own):
            return ours
        return own[1] if own is not None and now_s - own[0] <= OWN_VALID_S else None

    def _limits(self, now_s: float) -> dict[str, Value]:
        policy, rows = self._policy, self._setup.profile.history
        since_s = policy.motor_history.standing_since(self._setup.name)
        starts_s = policy.motor_history.starts_since(self._setup.name, now_s - HOUR_S)
        rules = policy.settings.of(self._setup.name)
        left = starts_left(rules.starts_per_hour, starts_s, now_s=now_s)
        self._announce(left)
        pause_s = pause_left_s(
            starts_s,
            standing_since_s=since_s,
            now_s=now_s,
            per_hour=rules.starts_per_hour,
            after_stop_s=max(rules.minimum_pause_s, self._setting(rows.after_stop)),
            between_starts_s=self._setting(rows.between_starts),
        )
        is_standing = self._counters.state in STANDING
        restart_s = self._thermal.restart_in_s(now_s) if is_standing else None
        return {
            "starts_left": left,
            "pause_left_s": float(round(pause_s)),
            "standstill_s": 0.0 if since_s is None else float(round(now_s - since_s)),
            "restart_in_s": None if restart_s is None else float(round(restart_s)),
        }

    def _setting(self, code: str) -> float:
        return self._own[code][1] if code in self._own else 0.0

    def _announce(self, left: int | None) -> None:
        """Publish once that one start is left, when it was more."""
        before, self._left = self._left, left
        if left == 1 and before is not None and before > 1:
            self._delivery.records.event(self._setup.name, EventCode.ONE_START_LEFT)


def _hours(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds / HOUR_S, 3)
