"""What a line has done so far, in numbers.

Response times are counted in classes of 5 %, old ones at half their weight from time to time, so that the
memory is bounded and follows a starter that changes.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, inf, log
from typing import Any, NamedTuple

from gateway.line.rtu.outcome import Answered, Garbled, Outcome
from gateway.line.rtu.reply import whole_frame
from gateway.line.scheduler.requests import Poll, Slot
from gateway.system.stalls import DelayCounts

_UTILISATION_WINDOW = 30  # samples, a second apart or more
_COMPUTED_AT_ONCE = 8
_COMPUTED_EVERY_S = 10.0
_STOP_BOUNDS_S = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5)
_OUTCOMES = ("answered", "silent", "garbled", "refused")
_CLASS = log(1.05)
_SHORTEST_S = 0.0001  # what is shorter counts as this
_FORGET_FROM = 4096  # answers, then each counts half

Quantiles = dict[str, float | None]


class LineTimes(NamedTuple):
    """How a line has spent its time, summed up since the start."""

    busy_s: float = 0.0
    requests_s: float = 0.0  # sending them
    delays_s: float = 0.0  # from a request's end to the first octet of its reply, or until that has not come
    replies_s: float = 0.0  # receiving them


class Statistics:
    """Counters since the start; utilisation and shares of time of about the last half minute.

    `stop_bound_of` computes how long a stop waits at most while these polls are asked.
    """

    def __init__(self, stop_bound_of: Callable[[Sequence[Poll]], float]) -> None:
        self.earlier_stray_bytes = 0  # on ports that were open before
        self._counts: Counter[str] = Counter()
        self._units: dict[int, _UnitStatistics] = {}
        self._changed: set[int] = set()  # units of which `_shown` is out of date
        self._shown: dict[int, dict[str, Any]] = {}  # what is published of each unit; never changed in place
        self._response_times = UnitResponseTimes()
        self._stop_bound_of = stop_bound_of
        self._stop_bound_s = stop_bound_of(())
        self._polls: Sequence[Poll] = ()  # that are asked, and what the latest slot of each took
        self._took_s: dict[str, float] = {}
        self._times = LineTimes()
        self._computed = 0  # so many units' response times were computed, since the start
        self._samples: deque[tuple[float, LineTimes]] = deque(maxlen=_UTILISATION_WINDOW)
        self._worst_stop_latency_s: float | None = None
        self._stops = DelayCounts(_STOP_BOUNDS_S)

    def begin(self, now_s: float) -> None:
        """Measure utilisation afresh: the port has just been opened."""
        self._samples.clear()
        self._samples.append((now_s, self._times))

    def note(
        self,
        slot: Slot,
        outcome: Outcome,
        *,
        took_s: float,
        now_s: float,
        request_s: float = 0.0,
        reply_s: float = 0.0,
        since_request_s: float = 0.0,
    ) -> None:
        """Count one slot, for which the line was busy for `took_s`, its silence included.

        `request_s` and `reply_s` are the times on the wire; `since_request_s` is from the request's end on.
        """
        busy_s, requests_s, delays_s, replies_s = self._times
        reply_s = max(min(reply_s, since_request_s), 0.0)
        self._times = LineTimes(
            busy_s + took_s,
            requests_s + request_s,
            delays_s + max(since_request_s - reply_s, 0.0),
            replies_s + reply_s,
        )
        if now_s - self._samples[-1][0] >= 1.0:
            self._samples.append((now_s, self._times))
        name = type(outcome).__name__.lower()
        self._counts["jobs" if slot.poll is None else "polls"] += 1
        self._counts[name] += 1
        unit = self._units.get(slot.unit)
        if unit is None:
            unit = self._units[slot.unit] = _UnitStatistics()
        unit.outcomes[name] += 1
        self._changed.add(slot.unit)
        if isinstance(outcome, Garbled) and outcome.is_sent and whole_frame(outcome.received) is None:
            unit.corrupted += 1
        if isinstance(outcome, Answered):
            self._response_times.note_answer(slot.unit, slot.request.function, outcome.response_time_s)
        if slot.poll is not None:
            self._took_s[slot.poll.key] = took_s

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
        self._response_times.forget(unit)

    def utilisation(self, now_s: float) -> float:
        """Return the share of time that the line was busy, 0..1; 0 before the first slot."""
        return min(self._shares(now_s).busy_s, 1.0)

    def time_share(self, now_s: float) -> dict[str, float]:
        """Return how the line spends its time, as shares of it; the rest it is idle."""
        busy, requests, delays, replies = self._shares(now_s)
        silences = max(busy - requests - delays - replies, 0.0)
        shares = {"requests": requests, "delays": delays, "replies": replies, "silences": silences}
        return {name: round(min(share, 1.0), 4) for name, share in shares.items()}

    def _shares(self, now_s: float) -> LineTimes:
        """Return the sums since the oldest sample, each divided by that time."""
        if not self._samples or now_s <= self._samples[0][0]:
            return LineTimes()
        since_s, before = self._samples[0]
        pairs = zip(self._times, before, strict=True)
        return LineTimes(*((now - then) / (now_s - since_s) for now, then in pairs))

    def to_dict(
        self,
        polls: Sequence[Poll],
        *,
        now_s: float,
        more_of: Callable[[int], Mapping[str, Any]] = lambda _: {},
    ) -> dict[str, Any]:
        """Return the payload of `B/gateway/line/{line}`; `sweep_s` is one slot of each of these polls.

        `more_of` says what else is published of a unit, once something was noted of it.
        """
        self._update_times(now_s)
        if polls != self._polls:
            self._polls, self._stop_bound_s = polls, self._stop_bound_of(polls)
        if self._took_s.keys() != {poll.key for poll in polls}:
            self._took_s = {poll.key: self._took_s.get(poll.key, 0.0) for poll in polls}  # others may be gone
        for unit in self._changed:
            self._shown[unit] = {**self._units[unit].to_dict(), **more_of(unit)}
        self._changed.clear()
        return {
            "utilisation": self.utilisation(now_s),
            "time_share": self.time_share(now_s),
            "sweep_s": float(sum(self._took_s.values())),
            **{name: self._counts[name] for name in ("polls", "jobs", *_OUTCOMES)},
            "stop_latency_s": {
                "computed": self._stop_bound_s,
                "worst": self._worst_stop_latency_s,
                **self._measured_stops(),
            },
            "units": dict(self._shown),
        }

    def _measured_stops(self) -> dict[str, Any]:
        stops = self._stops.taken()
        within = {f"{bound_s:g}": count for bound_s, count in zip(stops.bounds_s, stops.within, strict=False)}
        return {"stops": stops.within[-1], "sum": stops.total_s, "within": within}

    def _update_times(self, now_s: float) -> None:
        """Compute some units' response times anew; those of all at once would hold up the line."""
        units = list(self._units)
        first = self._computed % len(units) if units else 0
        for unit in (units[first:] + units[:first])[:_COMPUTED_AT_ONCE]:
            self._computed += 1
            each = self._units[unit]
            is_new = each.times["response_time_s"]["p50"] is None
            if is_new or now_s - each.computed_s >= _COMPUTED_EVERY_S:
                each.computed_s = now_s
                self._changed.add(unit)
                each.times = {
                    "response_time_s": self._response_times.quantiles(unit),
                    "functions": self._response_times.functions(unit),
                }


class _UnitStatistics:
    """One unit's counters, and its response times as they were last computed."""

    def __init__(self) -> None:
        self.outcomes = dict.fromkeys(_OUTCOMES, 0)
        self.corrupted = 0  # of the garbled ones: what came is no frame
        self.computed_s = -inf
        self.times: dict[str, Any] = {"response_time_s": {"p50": None, "p99": None}, "functions": {}}

    def to_dict(self) -> dict[str, Any]:
        asked = sum(self.outcomes.values())
        return {"asked": asked, **self.outcomes, "corrupted": self.corrupted, **self.times}


@dataclass(slots=True)
class _Class:
    """The answers whose times lie within 5 %."""

    count: int = 0
    sum_s: float = 0.0


class ResponseTimes:
    """A running distribution of response times."""

    def __init__(self) -> None:
        self._classes: dict[int, _Class] = {}
        self._total = 0

    @property
    def classes(self) -> Iterable[tuple[int, int, float]]:
        """What was counted: class, answers in it, the sum of their times."""
        return ((at, each.count, each.sum_s) for at, each in self._classes.items())

    def note(self, response_time_s: float) -> None:
        """Count one answer."""
        at = int(log(max(response_time_s, _SHORTEST_S)) / _CLASS)
        each = self._classes.get(at)
        if each is None:
            each = self._classes[at] = _Class()
        each.count += 1
        each.sum_s += response_time_s
        self._total += 1
        if self._total >= _FORGET_FROM:
            self._forget()

    def _forget(self) -> None:
        left = {
            at: _Class(each.count // 2, each.sum_s / each.count * (each.count // 2))
            for at, each in self._classes.items()
            if each.count > 1
        }
        self._classes = left
        self._total = sum(each.count for each in left.values())


def quantile_s(distributions: Iterable[ResponseTimes], share: float) -> float | None:
    """Return the time within which this share of all answers came, to about 5 %; None of nothing."""
    return _quantiles(distributions, {"": share})[""]


def _quantiles(distributions: Iterable[ResponseTimes], shares: Mapping[str, float]) -> Quantiles:
    """Return the times within which these shares of all answers came; the least share first."""
    joined = sorted(each for times in distributions for each in times.classes)
    total = sum(count for _, count, _ in joined)
    found: Quantiles = dict.fromkeys(shares)
    wanted = [(max(ceil(share * total), 1), name) for name, share in shares.items()]
    passed = 0
    for _, count, sum_s in joined:
        passed += count
        while wanted and wanted[0][0] <= passed:
            found[wanted.pop(0)[1]] = sum_s / count
    return found


class UnitResponseTimes:
    """The response times of a line's units, by unit and function."""

    def __init__(self) -> None:
        self._times: dict[int, dict[int, ResponseTimes]] = {}

    def note_answer(self, unit: int, function: int, response_time_s: float) -> None:
        """Count an answer of a unit."""
        functions = self._times.setdefault(unit, {})
        times = functions.get(function)
        if times is None:
            times = functions[function] = ResponseTimes()
        times.note(response_time_s)

    def forget(self, unit: int) -> None:
        """Know nothing of a unit any more."""
        self._times.pop(unit, None)

    def quantiles(self, unit: int) -> Quantiles:
        """Return p50 and p99 of a unit's response times, all functions together; None of nothing."""
        return _quantiles(self._times.get(unit, {}).values(), {"p50": 0.50, "p99": 0.99})

    def functions(self, unit: int) -> dict[int, Quantiles]:
        """Return p50, p99 and p99.9 of a unit by function."""
        shares = {"p50": 0.50, "p99": 0.99, "p999": 0.999}
        return {
            int(function): _quantiles((times,), shares)
            for function, times in self._times.get(unit, {}).items()
        }
