"""The communication watchdogs of the units: hard deadlines for their next valid telegram.

Any request that a unit answered has reached it, so it counts, whatever it was for. Half of a watchdog's time
may pass; then the unit is asked before everything but stops, which leaves the other half for a queue of other
such units and for one lost reply.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf

from gateway.line.scheduler.edf_queue import NOWHERE, EdfQueue, Listed

KEPT_SHARE = 0.5  # of a watchdog's time may pass before its unit is asked ahead of its turn
_RETRY_SHARE = 0.25  # of it passes after an attempt that was not answered
_PROBE_SHARE = 0.125  # of it passes between two attempts, at most, once it no longer answers
_WORST_OF_S = 60.0  # the worst is that of the last so many seconds at least, of twice as many at most


@dataclass(slots=True, eq=False, kw_only=True)
class _Watchdog(Listed):
    unit: int
    limit_s: float
    heard_s: float = -inf  # when the latest request that reached the unit had not yet been sent
    tried_s: float = -inf
    barred_until_s: float = -inf
    is_resting: bool = True

    def schedule(self) -> None:
        self.release_s = max(
            self.heard_s + KEPT_SHARE * self.limit_s,
            self.tried_s + _RETRY_SHARE * self.limit_s,
            self.barred_until_s,
        )
        self.deadline_s = self.heard_s + self.limit_s


class Watchdogs:
    """Which unit has to be asked, the earliest deadline first."""

    def __init__(self, places: Iterator[int]) -> None:
        self._agenda: EdfQueue[_Watchdog] = EdfQueue(places)
        self._watchdogs: dict[int, _Watchdog] = {}
        self._heard_s: dict[
            int, float
        ] = {}  # of every unit that answers, also without a watchdog that is known
        self._worst = self._worst_before = (0.0, 0)  # share of its time that a unit was left, and the unit
        self._worst_since_s = -inf

    def set(self, unit: int, limit_s: float | None) -> None:
        """Take over a unit's watchdog, None or 0 for none; it has counted since the unit was reached last."""
        old = self._watchdogs.pop(unit, None)
        if old is not None:
            old.place = NOWHERE
        if not limit_s:
            return
        new = self._watchdogs[unit] = _Watchdog(unit=unit, limit_s=limit_s)
        if old is not None and not old.is_resting:
            new.heard_s, new.tried_s, new.barred_until_s = old.heard_s, old.tried_s, old.barred_until_s
            new.is_resting = False
            self._put(new)
        elif unit in self._heard_s:
            new.heard_s, new.is_resting = self._heard_s[unit], False
            self._put(new)

    def heard(self, unit: int, at_s: float) -> None:
        """Take over that a unit was reached by a request sent after `at_s`."""
        self._heard_s[unit] = at_s
        watchdog = self._watchdogs.get(unit)
        if watchdog is None:
            return
        left_s, watchdog.heard_s = at_s - watchdog.heard_s, at_s
        if watchdog.is_resting:
            watchdog.is_resting = False
            self._put(watchdog)
        elif left_s > self._worst[0] * watchdog.limit_s:
            self._worst = (left_s / watchdog.limit_s, unit)

    def tried(self, unit: int, at_s: float) -> None:
        """Take over that a unit was asked in vain."""
        watchdog = self._watchdogs.get(unit)
        if watchdog is not None:
            watchdog.tried_s = at_s

    def bar(self, unit: int, until_s: float) -> None:
        """Take over that a unit cannot be asked before then."""
        watchdog = self._watchdogs.get(unit)
        if watchdog is not None:
            watchdog.barred_until_s = until_s

    def rest(self, unit: int) -> None:
        """Keep nothing for a unit that does not answer, until it is heard again."""
        self._heard_s.pop(unit, None)
        watchdog = self._watchdogs.get(unit)
        if watchdog is not None:
            watchdog.is_resting, watchdog.place = True, NOWHERE

    def retry_s(self, unit: int) -> float:
        """Return how soon to ask a silent unit again that may still hear us; infinite without a watchdog."""
        watchdog = self._watchdogs.get(unit)
        return inf if watchdog is None else _PROBE_SHARE * watchdog.limit_s

    def kept_every_s(self) -> dict[int, float]:
        """Return by unit that is kept from its watchdog how often it has to be asked for that."""
        return {
            unit: KEPT_SHARE * each.limit_s for unit, each in self._watchdogs.items() if not each.is_resting
        }

    def worst(self, now_s: float) -> tuple[float, int]:
        """Return the largest share of its watchdog's time that a unit was left lately, and which unit."""
        if now_s - self._worst_since_s >= _WORST_OF_S:
            self._worst_before = self._worst if now_s - self._worst_since_s < 2 * _WORST_OF_S else (0.0, 0)
            self._worst, self._worst_since_s = (0.0, 0), now_s
        return max(self._worst, self._worst_before)

    def first(self, now_s: float) -> int | None:
        """Return the unit that has to be asked now."""
        while (watchdog := self._agenda.first(now_s)) is not None:
            watchdog.schedule()
            if watchdog.release_s <= now_s:
                return watchdog.unit
            self._agenda.put(watchdog)  # it has been reached meanwhile
        return None

    def next_s(self) -> float:
        """Return when `first` may return a unit; not later than it does."""
        due = self._agenda.released() or self._agenda.upcoming()
        return inf if due is None else due.release_s

    def _put(self, watchdog: _Watchdog) -> None:
        watchdog.schedule()
        self._agenda.put(watchdog)
