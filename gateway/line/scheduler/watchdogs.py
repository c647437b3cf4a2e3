"""Which unit must be asked next for the sake of its communication watchdog: hard deadlines, earliest first.

Any answered request has reached its unit, whatever it was for. Half of a watchdog's time may pass; then the
unit is asked before jobs and polls, which leaves the other half for the queue and for one lost reply: after
that, half of what is left may pass. A unit that has not been asked since the port was opened counts as due:
its watchdog may be running.
"""

from __future__ import annotations

from math import inf

from gateway.line.scheduler.edf_queue import EdfQueue
from gateway.line.scheduler.units import Unit

ASKED_AFTER = 0.5  # of the time that is left to a watchdog

_WORST_OVER_S = 60.0  # the worst is that of the last so many seconds at least, of twice as many at most


class Watchdogs:
    """The deadlines of all units that answer and have polls."""

    def __init__(self) -> None:
        self._queue: EdfQueue[Unit] = EdfQueue()
        self._worst = self._worst_before = (0.0, 0)  # share of its time that a unit was left, and the unit
        self._worst_since_s = -inf

    def begin(self, unit: Unit, now_s: float) -> None:
        """Have a unit asked at once: the port has just been opened."""
        unit.release_s, unit.deadline_s = now_s, now_s + (unit.limit_s or inf)
        self._queue.put(unit)

    def set(self, unit: Unit, limit_s: float | None) -> None:
        """Record a unit's watchdog, None or 0 for none; it runs since the unit was reached last."""
        unit.limit_s = limit_s or 0.0
        if unit.reached_s == -inf and unit.queue is not None:
            self.begin(unit, unit.release_s)
        else:
            self._put(unit, unit.reached_s)

    def reached(self, unit: Unit, at_s: float) -> None:
        """Record that a unit was reached by a request sent at `at_s`."""
        left_s, unit.reached_s = at_s - unit.reached_s, at_s
        if unit.limit_s and self._worst[0] * unit.limit_s < left_s < inf:
            self._worst = (left_s / unit.limit_s, unit.number)
        self._put(unit, at_s)

    def missed(self, unit: Unit, now_s: float) -> None:
        """Record that a unit did not answer: it is asked again soon, a silent one only by its probe."""
        if unit.is_silent:
            unit.reached_s = -inf
        self._put(unit, now_s)

    def hold(self, unit: Unit, until_s: float) -> None:
        """Record that a unit may not be asked before then."""
        if unit.queue is not None:
            unit.release_s = max(unit.release_s, until_s)
            self._queue.put(unit)

    def first(self, now_s: float) -> Unit | None:
        """Return the unit that has to be asked now."""
        return self._queue.first(now_s)

    def next_s(self) -> float:
        """Return when `first` may return a unit; not later than it does."""
        return self._queue.next_s()

    def worst(self, now_s: float) -> tuple[float, int]:
        """Return the largest share of its watchdog's time that a unit was left lately, and which unit."""
        if now_s - self._worst_since_s >= _WORST_OVER_S:
            self._worst_before = self._worst if now_s - self._worst_since_s < 2 * _WORST_OVER_S else (0.0, 0)
            self._worst, self._worst_since_s = (0.0, 0), now_s
        return max(self._worst, self._worst_before)

    def _put(self, unit: Unit, asked_s: float) -> None:
        if not unit.limit_s or not unit.polls or unit.reached_s == -inf:
            unit.leave()
            return
        unit.deadline_s = unit.reached_s + unit.limit_s
        unit.release_s = asked_s + ASKED_AFTER * (unit.deadline_s - asked_s)
        if unit.misses:  # after the others, whom many that lose their supply at once would hold up
            unit.deadline_s += unit.limit_s
        self._queue.put(unit)
