"""What a line has done so far, in numbers."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from typing import Any

from gateway.line.job import Lane, Poll
from gateway.line.learnt import Learnt
from gateway.line.outcome import Answered, Outcome, Refused
from gateway.line.plan import Turn

_UTILISATION_WINDOW = 30  # samples, a second apart or more
_COUNTED_AT_ONCE = 64
_OUTCOMES = ("answered", "silent", "garbled", "refused")


class Figures:
    """Counters since the start; utilisation of about the last half minute."""

    def __init__(self) -> None:
        self._pending: list[tuple[Turn, Outcome, float]] = []  # not yet counted
        self._turns: Counter[str] = Counter()
        self._units: dict[int, _UnitFigures] = {}
        self._learnt = Learnt()
        self._took_s: dict[str, float] = {}
        self._busy_s = 0.0
        self._samples: deque[tuple[float, float]] = deque(maxlen=_UTILISATION_WINDOW)
        self._worst_stop_latency_s: float | None = None

    def begin(self, now_s: float) -> None:
        """Measure utilisation afresh: the port has just been opened."""
        self._samples.clear()
        self._samples.append((now_s, self._busy_s))

    def response_time_s(self, turn: Turn) -> float:
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

    def note(self, turn: Turn, outcome: Outcome, *, took_s: float, now_s: float) -> None:
        """Count one turn that kept the line busy for `took_s`, its silence included."""
        self._pending.append((turn, outcome, took_s))
        self._busy_s += took_s
        if now_s - self._samples[-1][0] >= 1.0:
            self._samples.append((now_s, self._busy_s))
        if len(self._pending) >= _COUNTED_AT_ONCE or not isinstance(outcome, Answered):
            self._count()

    def note_sent(self, turn: Turn, written_s: float) -> None:
        """Measure how long a stop waited for its first byte."""
        if turn.job is not None and turn.job.lane is Lane.STOP:
            self._worst_stop_latency_s = max(self._worst_stop_latency_s or 0.0, written_s - turn.since_s)

    def utilisation(self, now_s: float) -> float:
        """Return the share of time that the line was busy, 0..1; 0 before the first turn."""
        if not self._samples or now_s <= self._samples[0][0]:
            return 0.0
        since_s, busy_before_s = self._samples[0]
        return min((self._busy_s - busy_before_s) / (now_s - since_s), 1.0)

    def to_dict(self, polls: Iterable[Poll], *, worst_stop_latency_s: float, now_s: float) -> dict[str, Any]:
        """Return the figures of `B/gateway/line/{line}`; `sweep_s` is one turn of each of these polls."""
        self._count()
        return {
            "utilisation": self.utilisation(now_s),
            "sweep_s": float(sum(self._took_s.get(poll.key, 0.0) for poll in polls)),
            **{name: self._turns[name] for name in ("polls", "jobs", *_OUTCOMES)},
            "stop_latency_s": {"computed": worst_stop_latency_s, "worst": self._worst_stop_latency_s},
            "units": {unit: self._unit_dict(unit, figures) for unit, figures in self._units.items()},
        }

    def _count(self) -> None:
        """Count the turns that were noted: many at once take less time than each on its own."""
        turns = self._turns
        for turn, outcome, took_s in self._pending:
            turns["jobs" if turn.poll is None else "polls"] += 1
            name = type(outcome).__name__.lower()
            turns[name] += 1
            unit = self._units.get(turn.unit)
            if unit is None:
                unit = self._units[turn.unit] = _UnitFigures()
            unit.note(name)
            if isinstance(outcome, Answered):
                self._learnt.note_answer(turn.unit, turn.request.function, outcome.response_time_s)
            elif not isinstance(outcome, Refused) and outcome.is_sent:
                self._learnt.note_miss(turn.unit)
            if turn.poll is not None:
                self._took_s[turn.poll.key] = took_s
        self._pending.clear()

    def _unit_dict(self, unit: int, figures: _UnitFigures) -> dict[str, Any]:
        """Return a unit's figures, reckoned again only when it has been asked since."""
        if figures.reckoned is None:
            figures.reckoned = {
                **figures.to_dict(),
                "response_time_s": self._learnt.quantiles(unit),
                "functions": self._learnt.functions(unit),
            }
        return dict(figures.reckoned)


class _UnitFigures:
    """One unit's counters."""

    def __init__(self) -> None:
        self._outcomes: Counter[str] = Counter()
        self.reckoned: dict[str, Any] | None = None

    def note(self, outcome: str) -> None:
        self._outcomes[outcome] += 1
        self.reckoned = None

    def to_dict(self) -> dict[str, Any]:
        return {"asked": self._outcomes.total(), **{name: self._outcomes[name] for name in _OUTCOMES}}
