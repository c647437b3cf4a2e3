"""The line's time: who may take how much of it, and the factor by which all periods grow when it is short.

A budget is a token bucket of line time. The overload factor stretches all periods of a line together when it
is asked for more than it can do.
"""

from __future__ import annotations

from math import inf

from gateway.line.scheduler.units import ScheduledPoll

JOBS_SHARE = 0.5  # of the line's time while polls are due, for all jobs but stops
JOBS_BURST_S = 0.25  # of line time may be saved up: about what a start with its read-backs needs
# Of the line's time, for all silent units together: with the listening for a late reply that follows each
# silence, and is not counted here, that makes a twentieth at most.
OFFLINE_SHARE = 0.035
OFFLINE_BURST_S = 0.7  # of line time may be saved up: some six probes
FREE_PERIOD_S = 5.0  # the period of a poll with `every_s` 0; it comes earlier whenever the line is free

_AVERAGED_OVER_S = 10.0  # so far back goes the share of jobs and offline units


class LineTimeBudget:
    """Fills by a share of the time up to `burst_s`; begins full, and owes `burst_s` at most."""

    def __init__(self, share: float, burst_s: float) -> None:
        self._share = share
        self._burst_s = burst_s
        self._level_s = burst_s
        self._at_s = -inf

    def room_at_s(self) -> float:
        """Return from when on there is something in the bucket."""
        return self._at_s + max(0.0, -self._level_s / self._share)

    def has_room(self, now_s: float) -> bool:
        """Return whether there is something in the bucket; what is sent then may overdraw it once."""
        return now_s >= self.room_at_s()

    def spend(self, took_s: float, now_s: float) -> None:
        """Take out what was used of the line until now."""
        if now_s > self._at_s:
            self._level_s = min(self._level_s + (now_s - self._at_s) * self._share, self._burst_s)
            self._at_s = now_s
        self._level_s = max(self._level_s - took_s, -self._burst_s)

    def fill(self) -> None:
        """Forget what was spent."""
        self._level_s = self._burst_s


def period_of(every_s: float) -> float:
    """Return the period of a poll that asks for `every_s`."""
    return every_s or FREE_PERIOD_S


def overload_factor(load: float, *, others: float = 0.0) -> float:
    """Return the factor for a load, when others take their share first, half of the line's time at most."""
    return max(1.0, load / (1.0 - min(others, JOBS_SHARE)))


class LoadControl:
    """The present factor, from what the polls have cost and what others have taken."""

    def __init__(self) -> None:
        self.factor = 1.0
        self._load = 0.0
        self._others = 0.0
        self._at_s: float | None = None

    def set_cost(self, entry: ScheduledPoll, cost_s: float) -> None:
        """Note what a poll costs of the line's time whenever it is asked; 0 while it is not."""
        self._load += (cost_s - entry.cost_s) / entry.period_s
        entry.cost_s = cost_s

    def update(self, *, others_s: float, now_s: float) -> None:
        """Note that time has passed, of which jobs and offline units took `others_s`."""
        if self._at_s is not None and now_s > self._at_s:
            passed_s = now_s - self._at_s
            weight = min(passed_s / _AVERAGED_OVER_S, 1.0)
            self._others += weight * (min(others_s / passed_s, 1.0) - self._others)
        self._at_s = now_s
        self.factor = overload_factor(self._load, others=self._others)
