"""The order of one rank: its oldest rows in memory, the others in the table alone.

Invariants: `ids` is sorted. Every row up to `upto` is in memory, so that the next one is `ids[0]`; of the
later ones all are in the table, or on their way to it, and some may be in memory as well. `upto` is HIGHEST
when all are in memory.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable

from gateway.store import OutboxRow, Total

LOWEST, HIGHEST = -(2**60), 2**60  # no row has these ids


class RankQueue:
    """The rows of a rank that may be sent; `window` is how many of a long queue are in memory."""

    def __init__(self, window: int) -> None:
        self.ids: list[int] = []  # in memory
        self.upto = HIGHEST
        self.rows = 0  # in memory and beyond
        self.bytes = 0
        self.first_s = self.last_s = 0.0  # of those beyond: no later than the first, and the last
        self._window = window

    @property
    def beyond(self) -> int:
        """Return how many rows are not in memory, or only until the table has them."""
        return self.rows - len(self.ids)

    @property
    def wants_page(self) -> bool:
        """Return whether few rows are left of those up to which memory is whole."""
        return self.upto < HIGHEST and bisect_right(self.ids, self.upto) <= self._window // 2

    @property
    def is_next_here(self) -> bool:
        """Return whether the row that comes next is in memory."""
        return bool(self.ids) and self.ids[0] <= self.upto

    def __contains__(self, id_: int) -> bool:
        place = bisect_left(self.ids, id_)
        return place < len(self.ids) and self.ids[place] == id_

    def expect_table(self) -> None:
        """Take it that the table may have rows of earlier runs, which come first."""
        self.upto = LOWEST

    def recall(self, total: Total) -> None:
        """Count what the table has of earlier runs."""
        self._go_beyond(total.first_s, total.last_s)
        self.rows += total.rows
        self.bytes += total.bytes

    def add(self, row: OutboxRow) -> None:
        """Take a row at its place: into memory, or beyond when the window is full."""
        if self.upto == HIGHEST and len(self.ids) >= self._window:
            self.upto = self.ids[-1]
        if row.id <= self.upto:
            insort(self.ids, row.id)
        else:
            self._go_beyond(row.time_s, row.time_s)
        self.rows += 1
        self.bytes += row.size

    def remove(self, row: OutboxRow) -> None:
        """Remove a row that is in memory."""
        self.ids.pop(bisect_left(self.ids, row.id))
        self.rows -= 1
        self.bytes -= row.size
        self._close()

    def bring(self, ids: Iterable[int]) -> None:
        """Have rows of beyond in memory."""
        self.ids = sorted({*self.ids, *ids})

    def read(self, upto: int, time_s: float) -> None:
        """Note that memory has every row up to an id now, and what time the last of them has."""
        self.upto = max(self.upto, upto)
        self.first_s = time_s
        self._close()

    def lose_beyond(self, rows: int, bytes_: int) -> None:
        """Forget so many rows that were in the table alone."""
        self.rows = max(self.rows - rows, len(self.ids))
        self.bytes -= bytes_
        self._close()

    def _go_beyond(self, first_s: float, last_s: float) -> None:
        self.first_s = min(self.first_s, first_s) if self.beyond else first_s
        self.last_s = max(self.last_s, last_s) if self.beyond else last_s

    def _close(self) -> None:
        if not self.beyond and self.upto > LOWEST:
            self.upto = HIGHEST
