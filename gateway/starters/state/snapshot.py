"""The newest of one starter: its state, and the raw words from which commands are judged."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from gateway.contract import Quality
from gateway.starters.state.readings import Points, Value, good_values
from gateway.starters.state.starter_state import StarterState

Words = tuple[int, ...]


class Snapshot:
    """`state` is replaced whole with each reading; raw words stay, by the manual's code, however old."""

    def __init__(self, state: StarterState) -> None:
        self.state = state
        self.rows: dict[str, Words] = {}  # as read last, however old
        self._rows_at_s: dict[str, float] = {}

    @property
    def readings(self) -> Points:
        """Return the newest reading of each point."""
        return self.state.points

    def last_s(self, qualities: Collection[Quality] = tuple(Quality)) -> float | None:
        """Return when (UTC) a value that has one of these qualities was read last; None for never."""
        points = self.state.points
        times = (at.time_s for name, at in self.state.times.items() if points[name].quality in qualities)
        return max(times, default=None)

    def keep_rows(self, rows: Mapping[str, Words], *, at_s: float) -> None:
        """Record raw words that have just been read; older ones than those known are ignored."""
        times = self._rows_at_s
        newer = {code: words for code, words in rows.items() if times.get(code, -math.inf) <= at_s}
        self.rows |= newer
        self._rows_at_s |= dict.fromkeys(newer, at_s)

    def outdate_rows(self) -> None:
        """Let no row count as recent: another device may answer next."""
        self._rows_at_s.clear()

    def rows_since(self, since_s: float) -> dict[str, Words]:
        """Return the raw words of all rows that were read at `since_s` or later."""
        return {code: self.rows[code] for code, at_s in self._rows_at_s.items() if at_s >= since_s}

    def good_values(self) -> dict[str, Value]:
        """Return the values that were just read, by point."""
        return good_values(self.state.points)
