"""By how much all periods are stretched, so that what is asked of a line fits into its time.

An over-full line keeps every poll's share: all periods grow by the same factor. It comes from what the polls
cost, measured, against what jobs and silent units leave of the line.
"""

from __future__ import annotations

from collections.abc import Iterable

from gateway.line.scheduler.units import ScheduledPoll

SLACK = 1.05  # the stretched periods leave this much, so that a jam dissolves; idle time is not left idle
FREE_ROOM = 0.1  # of the line's time is left to polls without a period, where there are any
BUSY = 0.5  # from this fullness on polls go by due time, not by deadline; see `ages.py` for what that gives
EASED = 0.45  # and below this one by deadline again

_WEIGHT = 0.125  # of the newest cost
_OTHERS_OVER_S = 10.0  # the share of jobs and silent units is that of about the last so many seconds
_LEAST_ROOM = 0.05


def stretch_of(load: float, *, others: float, has_free: bool) -> float:
    """Return the factor for a load, both as shares of the line's time; others are served before."""
    return max(1.0, fullness_of(load, others=others, has_free=has_free))


def fullness_of(load: float, *, others: float, has_free: bool) -> float:
    """Return a load as a share of the line's time for it, slack set apart; above 1 periods are stretched."""
    return SLACK * load / room_of(others=others, has_free=has_free)


def room_of(*, others: float, has_free: bool) -> float:
    """Return the share of the line's time that is left to polls with a period."""
    return max(1.0 - others - (FREE_ROOM if has_free else 0.0), _LEAST_ROOM)


class LoadControl:
    """The present factor."""

    def __init__(self) -> None:
        self.factor = 1.0
        self.is_busy = False
        self._load = 0.0
        self._others = 0.0
        self._noted_s: float | None = None
        self._free_count = 0

    def count(self, entry: ScheduledPoll, *, is_counted: bool) -> None:
        """Take over a poll's period, and whether it is asked in its rhythm at present."""
        is_free = is_counted and not entry.every_s
        self._free_count += is_free - entry.is_free
        entry.is_free = is_free
        load = entry.cost_s / entry.every_s if is_counted and entry.every_s else 0.0
        self._load += load - entry.load
        entry.load, entry.is_counted = load, is_counted
        self._set_factor()

    def measure(self, entry: ScheduledPoll, took_s: float) -> None:
        """Learn what one transaction of a poll has cost; the first tells more than the guess."""
        weight = _WEIGHT if entry.is_measured else 1.0
        entry.is_measured = True
        entry.cost_s += weight * (took_s - entry.cost_s)
        if entry.is_counted:
            self.count(entry, is_counted=True)

    def pass_time(self, now_s: float, others_s: float) -> None:
        """Take over that time has passed, of which jobs, watchdogs and silent units took so much."""
        if self._noted_s is not None and now_s > self._noted_s:
            passed_s = now_s - self._noted_s
            weight = min(passed_s / _OTHERS_OVER_S, 1.0)
            self._others += weight * (min(others_s / passed_s, 1.0) - self._others)
            self._set_factor()
        self._noted_s = now_s

    def recount(self, entries: Iterable[ScheduledPoll]) -> None:
        """Add up anew, so that rounding does not."""
        self._load = sum(entry.load for entry in entries)
        self._set_factor()

    def _set_factor(self) -> None:
        fullness = fullness_of(self._load, others=self._others, has_free=self._free_count > 0)
        self.factor = max(1.0, fullness)
        self.is_busy = fullness > (EASED if self.is_busy else BUSY)
