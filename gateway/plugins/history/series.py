"""The values of all motors over time: of each step the least, the most and the last one.

1. In memory are the last ten minutes in steps of 2 s, and the last nine hours in steps of a minute. The hours
   of the points in `[history]` are stored too: a row an hour, rewritten every ten minutes, for seven days.
2. They are made of published values, so they are exact to the dead bands. A value holds until the next one;
   while it is not good, or the gateway stood still, there is a gap.
3. Steps are counted on the steady clock; UTC is computed when a row is written or a series is asked for.
"""

from __future__ import annotations

import asyncio
import math
from array import array
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import chain, dropwhile
from typing import NamedTuple

from gateway.contract import Quality, RecordWriter, ValueRecord
from gateway.errors import StoreError
from gateway.store import HistoryRow, HistoryStore

SERIES = "series"  # kind of the rows
SHOWN = ("current", "line_voltage", "output_voltage")  # points that are in memory where a page shows them
FINE_S, FINE_STEPS = 2.0, 300
MINUTE_S, MINUTES = 60.0, 540
HOUR_S, PER_HOUR = 3600.0, 60
BEAT_S = 2.0
STILL_S = 6.0  # without a beat for longer, the gateway stood still: nothing was read
STORE_EVERY_S = 590.0  # what a kill loses is ten minutes
MOST_AT_ONCE = 2  # starters that are stored at one beat: the loop has other work as well
ROWS = 192  # of each starter that stay: seven days, and a row more for each of 24 restarts
NAN = math.nan


class Sample(NamedTuple):
    """The values of one step."""

    at_s: float  # its middle
    least: float
    most: float
    last: float


class Series(NamedTuple):
    """A point over time, in steps of equal length up to now; None where it was not known."""

    least: list[float | None]
    most: list[float | None]
    last: list[float | None]


class Steps:
    """The last `slots` steps of one point, in memory of a fixed size; times on the steady clock."""

    __slots__ = ("_columns", "_held", "_slot", "_slots", "step_s")

    def __init__(self, step_s: float, slots: int) -> None:
        self.step_s = step_s
        self._slots = slots
        self._columns = tuple(array("f", [NAN]) * slots for _ in range(3))
        self._slot: int | None = None  # the newest
        self._held = NAN

    def put(self, value: float, now_s: float) -> None:
        """Record a value; NaN where it is not known from now on."""
        self._advance(now_s)
        index = (self._slot or 0) % self._slots
        least, most, last = self._columns
        if not math.isnan(value):  # which wins against a NaN that is the second one
            least[index], most[index] = min(value, least[index]), max(value, most[index])
        last[index] = self._held = value

    def forget(self, since_s: float, now_s: float) -> None:
        """Make the whole steps between two times unknown; the value holds again after them."""
        self._advance(now_s)
        newest = int(now_s // self.step_s)
        for each in range(max(int(since_s // self.step_s), newest - self._slots) + 1, newest):
            for column in self._columns:
                column[each % self._slots] = NAN

    def samples(self, now_s: float) -> Iterator[Sample]:
        """Yield the steps up to now, the oldest first."""
        self._advance(now_s)
        newest = self._slot or 0
        for slot in range(newest - self._slots + 1, newest + 1):
            values = (column[slot % self._slots] for column in self._columns)
            yield Sample((slot + 0.5) * self.step_s, *values)

    def _advance(self, now_s: float) -> None:
        """Go on to the present step; in those between the value was the one that is held."""
        slot = int(now_s // self.step_s)
        before = slot - 1 if self._slot is None else self._slot
        for each in range(max(before, slot - self._slots) + 1, slot + 1):
            for column in self._columns:
                column[each % self._slots] = self._held
        self._slot = max(before, slot)


class AllSeries:
    """The values of all motors; all calls on the app's loop. Only `over` waits for the disk."""

    def __init__(
        self, records: RecordWriter, store: HistoryStore, points: Iterable[str], *, has_page: bool
    ) -> None:
        """`points` are stored; none: nothing is. `SHOWN` are in memory too where there is a page."""
        self._records = records
        self._store = store
        self._points = tuple(points)
        self._shown = SHOWN if has_page else ()
        self._ever = set(self._points)  # stored in this run
        self._steps: dict[tuple[str, str], tuple[Steps, Steps]] = {}  # by starter and point
        self._stored_s: dict[str, float] = {}  # by starter; before that, when its first value came
        self._beat_s = records.clock.now_s()

    def reconfigure(self, starters: Iterable[str], points: Iterable[str], *, has_page: bool) -> None:
        """Store these points; of a starter that is gone nothing is known from now on, or stored."""
        wanted, now_s = set(starters), self._records.clock.now_s()
        for gone in self._stored_s.keys() - wanted:
            self._write(gone)
            del self._stored_s[gone]
        self._points, self._shown = tuple(points), SHOWN if has_page else ()
        self._ever.update(self._points)
        traced = {*self._points, *self._shown}  # of an hour that is stored the row may be rewritten once more
        self._steps = {key: both for key, both in self._steps.items() if key[1] in traced | self._ever}
        for (starter, point), both in self._steps.items():
            for steps in both if starter not in wanted or point not in traced else ():
                steps.put(NAN, now_s)

    def put(self, record: ValueRecord) -> None:
        """Record a value, if it is a number of a point that is wanted."""
        if record.point not in self._points and record.point not in self._shown:
            return
        key, value, now_s = (record.starter, record.point), record.value, self._records.clock.now_s()
        is_known = record.quality is Quality.GOOD and isinstance(value, (int, float))
        if is_known and key not in self._steps:
            self._steps[key] = Steps(FINE_S, FINE_STEPS), Steps(MINUTE_S, MINUTES)
        for steps in self._steps.get(key, ()):
            steps.put(float(value or 0.0) if is_known else NAN, now_s)
        if record.point in self._points:
            self._stored_s.setdefault(record.starter, now_s)

    def beat(self) -> None:
        """Note that the gateway is at work, and have a few hours stored; called every `BEAT_S`."""
        now_s = self._records.clock.now_s()
        since_s, self._beat_s = self._beat_s, now_s
        if now_s - since_s > STILL_S:
            for steps in chain.from_iterable(self._steps.values()):
                steps.forget(since_s, now_s)
        due = [starter for starter, at_s in self._stored_s.items() if now_s - at_s >= STORE_EVERY_S]
        for starter in due[:MOST_AT_ONCE]:
            self._write(starter)

    def write(self) -> None:
        """Have everything stored that is not yet."""
        for starter in self._stored_s:
            self._write(starter)

    def _write(self, starter: str) -> None:
        """Have a starter's present hour stored, and the ones before that are not stored to their end."""
        clock, now_s = self._records.clock, self._records.clock.now_s()
        first, last = int(self._stored_s[starter] // HOUR_S), int(now_s // HOUR_S)
        self._stored_s[starter] = now_s
        known = [point for point in self._points if (starter, point) in self._steps]
        for hour in range(max(first, last - MINUTES // PER_HOUR + 1), last + 1 if known else first):
            data = {
                "begin": clock.utc_s(hour * HOUR_S),
                "points": {point: self._hour(starter, point, hour, now_s) for point in known},
            }
            self._store.put(HistoryRow(starter, SERIES, f"{self._records.boot}-{hour}", data, ROWS))

    def points(self, starter: str) -> list[str]:
        """Return the points of a starter that were a number in this run, the current first."""
        return sorted(
            (point for name, point in self._steps if name == starter), key=lambda p: (p != SHOWN[0], p)
        )

    async def over(self, starter: str, point: str, *, span_s: float, steps: int) -> Series:
        """Return a point over so long up to now; the last ten minutes are never read from the disk."""
        clock, now_s, rows = self._records.clock, self._records.clock.now_s(), list[HistoryRow]()
        is_fine = span_s <= FINE_S * FINE_STEPS
        width_s = FINE_S if is_fine else MINUTE_S
        begin_s = clock.utc_s((now_s // width_s + 1) * width_s) - span_s
        if not is_fine and point in self._points:
            with suppress(StoreError):  # then only this run's are shown
                rows = await self._store.rows(starter, (SERIES,))
        known = self._steps.get((starter, point))
        samples = [] if known is None else [*_begun(known[not is_fine].samples(now_s))]
        found = [sample._replace(at_s=clock.utc_s(sample.at_s)) for sample in samples]
        gather = partial(gathered, begin_s=begin_s, step_s=span_s / steps, steps=steps)
        return await asyncio.to_thread(gather, chain(_stored(rows, point), found)) if rows else gather(found)

    def _hour(self, starter: str, point: str, hour: int, now_s: float) -> list[list[float | None]]:
        """Return the least, the most and the last values of an hour's minutes up to now."""
        _, minutes = self._steps[starter, point]
        samples = [each for each in minutes.samples(now_s) if each.at_s // HOUR_S == hour]
        return [[_short(each[column]) for each in samples] for column in (1, 2, 3)]


def gathered(samples: Iterable[Sample], *, begin_s: float, step_s: float, steps: int) -> Series:
    """Return samples in steps of another length: the least and the most of all in a step, and the last."""
    columns = [[NAN] * steps for _ in range(3)]
    for at_s, least, most, last in samples:
        index = int((at_s - begin_s) // step_s)
        if not 0 <= index < steps:
            continue
        lows, highs, lasts = columns
        if not math.isnan(least):
            lows[index], highs[index] = min(least, lows[index]), max(most, highs[index])
        lasts[index] = last
    return Series(*([_short(value) for value in column] for column in columns))


def _stored(rows: Sequence[HistoryRow], point: str) -> Iterator[Sample]:
    """Yield what rows of hours say of a point; what is no row is as good as missing."""
    for row in rows:
        with suppress(KeyError, TypeError, ValueError):
            begin_s, columns = row.data["begin"], row.data["points"][point]
            known = [[NAN if value is None else float(value) for value in column] for column in columns]
            minutes = enumerate(zip(*known, strict=False))
            yield from _begun(Sample(begin_s + (at + 0.5) * MINUTE_S, *values) for at, values in minutes)


def _begun(samples: Iterable[Sample]) -> Iterator[Sample]:
    """Return samples from the first one that is known: of what was before it, another run may know."""
    return dropwhile(lambda each: math.isnan(each.most) and math.isnan(each.last), samples)


def _short(value: float) -> float | None:
    """Return a number of four digits, for JSON."""
    return None if math.isnan(value) else float(f"{value:.4g}")
