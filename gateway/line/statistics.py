"""What a line has done so far, in numbers."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from math import inf
from typing import Any

from gateway.line.rtu.outcome import Answered, Outcome, Refused
from gateway.line.rtu.response_time import ResponseTimeEstimator
from gateway.line.scheduler.requests import Poll, Priority, Slot

_UTILISATION_WINDOW = 30  # samples, a second apart or more
_RECKONED_AT_ONCE = 8
_RECKONED_EVERY_S = 10.0
_OUTCOMES = ("answered", "silent", "garbled", "refused")


class Statistics:
    """Counters since the start; utilisation of about the last half minute."""

    def __init__(self) -> None:
        self._turns: Counter[str] = Counter()
        self._units: dict[int, _UnitStatistics] = {}
        self._learnt = ResponseTimeEstimator()
        self._took_s: dict[str, float] = {}
        self._busy_s = 0.0
        self._reckoned = 0  # so many units' response times, since the start
        self._samples: deque[tuple[float, float]] = deque(maxlen=_UTILISATION_WINDOW)
        self._worst_stop_latency_s: float | None = None

    def begin(self, now_s: float) -> None:
        """Measure utilisation afresh: the port has just been opened."""
        self._samples.clear()
        self._samples.append((now_s, self._busy_s))

    def response_time_s(self, turn: Slot) -> float:
        """Return how long to wait for a reply's first byte, by what was learnt as far as that is allowed."""
        poll = turn.poll
        if poll is None or poll.response_floor_s is None:
            return turn.response_time_s
        return self._learnt.response_time_s(
            turn.unit,
            turn.request.function,
            limit_s=turn.response_time_s,
            floor_s=poll.response_floor_s,
        )

    def note(self, turn: Slot, outcome: Outcome, *, took_s: float, now_s: float) -> None:
        """Count one turn that kept the line busy for `took_s`, its silence included."""
        self._busy_s += took_s
        if now_s - self._samples[-1][0] >= 1.0:
            self._samples.append((now_s, self._busy_s))
        name = type(outcome).__name__.lower()
        self._turns["jobs" if turn.poll is None else "polls"] += 1
        self._turns[name] += 1
        unit = self._units.get(turn.unit)
        if unit is None:
            unit = self._units[turn.unit] = _UnitStatistics()
        unit.outcomes[name] += 1
        if isinstance(outcome, Answered):
            self._learnt.note_answer(turn.unit, turn.request.function, outcome.response_time_s)
        elif not isinstance(outcome, Refused) and outcome.is_sent:
            self._learnt.note_miss(turn.unit)
        if turn.poll is not None:
            self._took_s[turn.poll.key] = took_s

    def note_sent(self, turn: Slot, written_s: float) -> None:
        """Measure how long a stop waited for its first byte."""
        if turn.lane is Priority.STOP:
            self._worst_stop_latency_s = max(self._worst_stop_latency_s or 0.0, written_s - turn.since_s)

    def forget(self, unit: int) -> None:
        """Know nothing of a unit any more; what it has cost still counts."""
        self._units.pop(unit, None)
        self._learnt.forget(unit)

    def utilisation(self, now_s: float) -> float:
        """Return the share of time that the line was busy, 0..1; 0 before the first turn."""
        if not self._samples or now_s <= self._samples[0][0]:
            return 0.0
        since_s, busy_before_s = self._samples[0]
        return min((self._busy_s - busy_before_s) / (now_s - since_s), 1.0)

    def to_dict(self, polls: Iterable[Poll], *, worst_stop_latency_s: float, now_s: float) -> dict[str, Any]:
        """Return the figures of `B/gateway/line/{line}`; `sweep_s` is one turn of each of these polls."""
        self._reckon(now_s)
        self._took_s = {poll.key: self._took_s.get(poll.key, 0.0) for poll in polls}  # others may be gone
        return {
            "utilisation": self.utilisation(now_s),
            "sweep_s": float(sum(self._took_s.values())),
            **{name: self._turns[name] for name in ("polls", "jobs", *_OUTCOMES)},
            "stop_latency_s": {"computed": worst_stop_latency_s, "worst": self._worst_stop_latency_s},
            "units": {unit: figures.to_dict() for unit, figures in self._units.items()},
        }

    def _reckon(self, now_s: float) -> None:
        """Reckon some units' response times anew, in turn: those of all at once would hold up the line."""
        units = list(self._units)
        first = self._reckoned % len(units) if units else 0
        for unit in (units[first:] + units[:first])[:_RECKONED_AT_ONCE]:
            self._reckoned += 1
            figures = self._units[unit]
            is_new = figures.times["response_time_s"]["p50"] is None
            if is_new or now_s - figures.reckoned_s >= _RECKONED_EVERY_S:
                figures.reckoned_s = now_s
                figures.times = {
                    "response_time_s": self._learnt.quantiles(unit),
                    "functions": self._learnt.functions(unit),
                }


class _UnitStatistics:
    """One unit's counters, and its response times when they were last reckoned."""

    def __init__(self) -> None:
        self.outcomes: Counter[str] = Counter()
        self.reckoned_s = -inf
        self.times: dict[str, Any] = {"response_time_s": {"p50": None, "p99": None}, "functions": {}}

    def to_dict(self) -> dict[str, Any]:
        counts = {name: self.outcomes[name] for name in _OUTCOMES}
        return {"asked": self.outcomes.total(), **counts, **self.times}
