"""The line's time: who may take how much of it, and the factor by which all periods grow when it is short."""

from __future__ import annotations

from math import inf

JOBS_SHARE = 0.5  # of the line's time while polls are due, for all jobs but stops
JOBS_BURST_S = 0.25  # of line time may be saved up: about what a start with its read-backs needs
# Of the line's time, for all silent units together: with the listening for a late reply that follows each
# silence, and is not counted here, that makes a twentieth at most.
OFFLINE_SHARE = 0.035
OFFLINE_BURST_S = 0.7  # of line time may be saved up: some six probes
FREE_PERIOD_S = 5.0  # the period of a poll with `every_s` 0; it comes earlier whenever the line is free


class LineTimeBudget:
    """A token bucket that a share of the time fills up to `burst_s`; begins full, owes `burst_s` at most."""

    def __init__(self, share: float, burst_s: float) -> None:
        self._share = share
        self._fills_in_s = burst_s / share
        self._full_at_s = -inf

    def room_at_s(self) -> float:
        """Return from when on something may be sent, which may overdraw the bucket once."""
        return self._full_at_s - self._fills_in_s

    def spend(self, took_s: float, now_s: float) -> None:
        """Take out what was used of the line until now."""
        full_at_s = max(self._full_at_s, now_s) + took_s / self._share
        self._full_at_s = min(full_at_s, now_s + 2 * self._fills_in_s)

    def fill(self) -> None:
        """Forget what was spent."""
        self._full_at_s = -inf


def overload_factor(load: float, *, others: float = 0.0) -> float:
    """Return the factor for a load, when others take their share first, half of the line's time at most."""
    return max(1.0, load / (1.0 - min(others, JOBS_SHARE)))
