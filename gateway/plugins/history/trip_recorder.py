"""From the readings, states and events of one starter to the record of each trip.

1. Every good reading goes into the ring, which remembers a minute. A fault is a trip once its event comes:
   two readings have shown it.
2. The moment of the trip is the first reading that showed the fault, on the steady clock: no step of the
   wall clock moves it.
3. The record waits for what is read of the starter after the trip (`add_fault_data`), for the fault's
   number and for `AFTER_S` of readings; no longer than `LATEST_S`.
4. Another trip while one waits finishes the first one as it is.
5. Each point has two arrays of its own in the ring, times and values. A value that does not change has two
   entries, the first and the latest reading of it; what is older than `KEEP_S` goes; a point that was read
   `MOST` times gives up every other reading of its older half: near the present nothing is missing.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from gateway.contract import EventRecord, ReadingTable, TripRecord

AFTER_S = 2.0  # of readings that follow the trip
LATEST_S = 15.0  # after which it is published with what is known
MOST_BYTES = 16 * 1024  # of the JSON of a record
ALWAYS_S = 10.0  # before the trip: what is nearer is thinned last
NOTHING = ReadingTable((), {}, {})
FAULT = "fault"  # the point; also the alarm as long as its number is not known
BEFORE_S = 60.0  # what a record shows of the time before it
KEEP_S = BEFORE_S + 30.0  # a record is finished that much later at most
TRIM_S = 5.0  # old readings go that much later, many at once
MOST = 240  # readings of one point: four a second for a minute
DIGITS = 7  # that a stored value has: 32 bit floating point

Number = bool | int | float


class _PointReadings:
    """The readings of one point."""

    __slots__ = ("is_standing", "kind", "last", "times", "values")

    def __init__(self, kind: type) -> None:
        self.kind = kind
        self.times = array("d")
        self.values = array("f")
        self.last: Number | None = None
        self.is_standing = False  # the last two entries have this value: most flags, most of the time

    def add(self, at_s: float, value: Number) -> None:
        times = self.times
        if times and at_s <= times[-1]:
            return
        is_same = value == self.last
        if is_same and self.is_standing:
            times[-1] = at_s
            return
        self.is_standing, self.last = is_same, value
        times.append(at_s)
        self.values.append(value)
        if len(times) > 2 and at_s - times[1] > KEEP_S + TRIM_S:
            self._trim(at_s - KEEP_S)
        if len(times) >= MOST:
            self._thin()

    def _trim(self, since_s: float) -> None:
        count = 0
        while self.times[count + 1] < since_s:  # one older reading stays: its value may stand into the window
            count += 1
        del self.times[:count]
        del self.values[:count]

    def _thin(self) -> None:
        half = len(self.times) // 2
        self.times = self.times[:half:2] + self.times[half:]
        self.values = self.values[:half:2] + self.values[half:]

    def shown(self, value: float) -> Number:
        """Return a stored value as what it was."""
        if self.kind is float:
            return float(f"{value:.{DIGITS - 1}g}")
        return bool(value) if self.kind is bool else int(value)


class ReadingRing:
    """The readings of one starter; times are on the steady clock, only numbers and flags are stored."""

    __slots__ = ("_series",)

    def __init__(self) -> None:
        self._series: dict[str, _PointReadings] = {}

    def note(self, values: Mapping[str, Any], *, at_s: float) -> None:
        """Add good readings, all of one moment; one that is older than the point's last is ignored."""
        for name, value in values.items():
            if not isinstance(value, (bool, int, float)):
                continue
            series = self._series.get(name)
            if series is None or series.kind is not type(value):
                series = self._series[name] = _PointReadings(type(value))
            series.add(at_s, value)

    def began_s(self, point: str) -> float | None:
        """Return when a flag that is on now was read as on for the first time; None when it is off."""
        series = self._series.get(point)
        if series is None or not series.values or not series.values[-1]:
            return None
        began_s = series.times[-1]
        for at_s, value in zip(reversed(series.times), reversed(series.values), strict=True):
            if not value:
                break
            began_s = at_s
        return began_s

    def around(self, moment_s: float, *, before_s: float = BEFORE_S) -> ReadingTable:
        """Return what was read from `before_s` before a moment up to now, with times relative to it."""
        found: dict[float, dict[str, Number]] = {}
        for name, series in self._series.items():
            for at_s, value in self._window(series, moment_s - before_s):
                found.setdefault(round(at_s - moment_s, 3), {})[name] = series.shown(value)
        return table_of(sorted(found.items()))

    @staticmethod
    def _window(series: _PointReadings, since_s: float) -> Iterator[tuple[float, float]]:
        """Give the readings since a moment; a value that stood before it begins there."""
        last: tuple[float, float] | None = None
        for at_s, value in zip(series.times, series.values, strict=True):
            if at_s < since_s:
                last = (at_s, value)
                continue
            if last is not None and last[1] == value:
                yield since_s, value
            last = None
            yield at_s, value


def table_of(moments: list[tuple[float, dict[str, Number]]]) -> ReadingTable:
    """Return the table of some moments in order of time; a point that never changed is a constant."""
    names = sorted({name for _, values in moments for name in values})
    seen = {name: {values[name] for _, values in moments if name in values} for name in names}
    constant = {name: values.pop() for name, values in seen.items() if len(values) == 1}
    varying = [name for name in names if name not in constant]
    shown = [(t_s, values) for t_s, values in moments if not values.keys().isdisjoint(varying)]
    if not shown and moments:
        shown = [moments[0], moments[-1]] if len(moments) > 1 else moments
    columns = {name: tuple(values.get(name) for _, values in shown) for name in varying}
    return ReadingTable(tuple(t_s for t_s, _ in shown), columns, constant)


def without(table: ReadingTable, rows: set[int]) -> ReadingTable:
    """Return a table with some of its moments left out."""
    left = [row for row in range(len(table.t_s)) if row not in rows]
    columns = {name: tuple(column[row] for row in left) for name, column in table.points.items()}
    return ReadingTable(tuple(table.t_s[row] for row in left), columns, table.constant)


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
