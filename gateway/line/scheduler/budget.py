"""A token bucket of line time."""

from __future__ import annotations

from math import inf


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
