"""The counts and times of a line so far."""

from __future__ import annotations

from array import array
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from math import ceil
from typing import Any

from gateway.line.rtu.reply import first_frame
from gateway.line.rtu.transaction import Answered, Garbled, Outcome
from gateway.line.scheduler.requests import Slot
from gateway.system.stalls import DelayCounts

_UTILISATION_WINDOW = 30  # samples, a second apart or more
_LATEST = 100  # replies of a unit, whose times count
_STOP_BOUNDS_S = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5)
_OUTCOMES = ("answered", "silent", "garbled", "refused")


class Statistics:
    """Counters since the start; utilisation is that of about the last half minute."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._units: dict[int, _UnitStatistics] = {}
        self._changed: set[int] = set()  # units of which `_shown` is out of date
        self._shown: dict[int, dict[str, Any]] = {}  # what is published of each unit; never changed in place
        self._busy_s = 0.0
        self._samples: deque[tuple[float, float]] = deque(maxlen=_UTILISATION_WINDOW)  # when, and `_busy_s`
        self._worst_stop_latency_s: float | None = None
        self._stops = DelayCounts(_STOP_BOUNDS_S)

    def begin(self, now_s: float) -> None:
        """Measure utilisation afresh: the port has just been opened."""
        self._samples.clear()
        self._samples.append((now_s, self._busy_s))

    def note(self, slot: Slot, outcome: Outcome, *, took_s: float, now_s: float) -> None:
        """Count one slot, for which the line was busy for `took_s`, its silence included."""
        self._busy_s += took_s
        if now_s - self._samples[-1][0] >= 1.0:
            self._samples.append((now_s, self._busy_s))
        name = type(outcome).__name__.lower()
        self._counts["jobs" if slot.poll is None else "polls"] += 1
        self._counts[name] += 1
        unit = self._units.get(slot.unit) or self._units.setdefault(slot.unit, _UnitStatistics())
        unit.outcomes[name] += 1
        self._changed.add(slot.unit)
        if isinstance(outcome, Garbled) and outcome.is_sent:
            unit.corrupted += first_frame(outcome.received)[1] != outcome.received
        if isinstance(outcome, Answered):
            unit.times_s.append(outcome.response_time_s)
            del unit.times_s[:-_LATEST]

    def note_late(self, unit: int) -> None:
        """Record that something else is to be published of a unit: a reply of it came late."""
        if unit in self._units:
            self._changed.add(unit)

    def note_stop(self, slot: Slot, written_s: float) -> None:
        """Measure how long a stop waited for its first byte."""
        waited_s = written_s - slot.since_s
        self._worst_stop_latency_s = max(self._worst_stop_latency_s or 0.0, waited_s)
        self._stops.note(waited_s)

    def forget(self, unit: int) -> None:
        """Know nothing of a unit any more; what it has cost still counts."""
        self._units.pop(unit, None)
        self._shown.pop(unit, None)
        self._changed.discard(unit)

    def utilisation(self, now_s: float) -> float:
        """Return the share of time that the line was busy, 0..1; 0 before the first slot."""
        if not self._samples or now_s <= self._samples[0][0]:
            return 0.0
        since_s, before_s = self._samples[0]
        return min((self._busy_s - before_s) / (now_s - since_s), 1.0)

    def to_dict(
        self, *, now_s: float, more_of: Callable[[int], Mapping[str, Any]] = lambda _: {}
    ) -> dict[str, Any]:
        """Return what `B/gateway/line/{line}` says of it, but for the computed wait of a stop.

        `more_of` says what else is published of a unit, once something was noted of it.
        """
        for unit in self._changed:
            self._shown[unit] = {**self._units[unit].to_dict(), **more_of(unit)}
        self._changed.clear()
        return {
            "utilisation": self.utilisation(now_s),
            **{name: self._counts[name] for name in ("polls", "jobs", *_OUTCOMES)},
            "stop_latency_s": {"worst": self._worst_stop_latency_s, **self._measured_stops()},
            "units": dict(self._shown),
        }

    def _measured_stops(self) -> dict[str, Any]:
        stops = self._stops.taken()
        within = {f"{bound_s:g}": count for bound_s, count in zip(stops.bounds_s, stops.within, strict=False)}
        return {"stops": stops.within[-1], "sum": stops.total_s, "within": within}


class _UnitStatistics:
    """One unit's counters, and the times of its latest replies."""

    def __init__(self) -> None:
        self.outcomes = dict.fromkeys(_OUTCOMES, 0)
        self.corrupted = 0  # of the garbled ones: what came is no frame
        self.times_s = array("d")  # a quarter of the room of a deque of floats

    def to_dict(self) -> dict[str, Any]:
        times_s = sorted(self.times_s)
        return {
            "asked": sum(self.outcomes.values()),
            **self.outcomes,
            "corrupted": self.corrupted,
            "response_time_s": {"p50": quantile(times_s, 0.5), "p99": quantile(times_s, 0.99)},
        }


def quantile(ordered: Sequence[float], share: float) -> float | None:
    """Return the least of these ordered numbers up to which such a share of them lies; None of none."""
    return ordered[ceil(share * len(ordered)) - 1] if ordered else None
