"""The order of one rank: rows in memory, and others that the table alone has.

Invariants: `ids` is sorted. Every row up to `upto` is in memory, so that the next one is `ids[0]`; of the
later ones those that the table has not are in memory too. `upto` is HIGHEST when all are in memory.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable

from gateway.store import OutboxRow, Total

LOWEST, HIGHEST = -(2**60), 2**60  # no row has these ids


class RankQueue:
    """The rows of a rank; `window` is how many of a long queue stay in memory."""

    def __init__(self, window: int) -> None:
        self.ids: list[int] = []  # in memory, and to be sent
        self.sent: set[int] = set()  # in memory, and not acknowledged
        self.upto = HIGHEST
        self.rows = self.bytes = 0  # in memory and beyond
        self.first_s = self.last_s = 0.0  # of those beyond: no later than the first, and the last
        self._window = window

    @property
    def beyond(self) -> int:
        """Return how many rows the table alone has."""
        return self.rows - len(self.ids) - len(self.sent)

    @property
    def wants_page(self) -> bool:
        """Return whether few rows are left of those up to which memory is whole."""
        return self.upto < HIGHEST and bisect_right(self.ids, self.upto) <= self._window // 2

    @property
    def is_next_here(self) -> bool:
        """Return whether the row that comes next is in memory."""
        return bool(self.ids) and self.ids[0] <= self.upto

    def recall(self, total: Total) -> None:
        """Count the rows of earlier runs, which the table has."""
        self._go_beyond(total.first_s, total.last_s)
        self.rows += total.rows
        self.bytes += total.bytes

    def add(self, row: OutboxRow) -> None:
        """Take a new row at its place."""
        self.rows += 1
        self.bytes += row.size
        self._place(row)

    def take(self, row: OutboxRow) -> None:
        """Note that a row that is in memory is sent."""
        self._displace(row)
        self.sent.add(row.id)
        self._close()

    def give_back(self, row: OutboxRow) -> None:
        """Put a row that was sent back into its place."""
        self.sent.remove(row.id)
        self._place(row)

    def remove(self, row: OutboxRow) -> None:
        """Remove a row, which the broker has, or which is lost."""
        if row.id in self.sent:
            self.sent.remove(row.id)
        else:
            self._displace(row)
        self.rows -= 1
        self.bytes -= row.size
        self._close()

    def leave(self, row: OutboxRow) -> None:
        """Leave a row to the table, which has it."""
        self._go_beyond(row.time_s, row.time_s)
        self._displace(row)

    def bring(self, ids: Iterable[int], upto: int, time_s: float) -> None:
        """Have rows of beyond in memory, which now has all up to an id; the last of them has this time."""
        self.ids = sorted({*self.ids, *ids})
        self.upto = max(self.upto, upto)
        self.first_s = time_s
        self._close()

    def lose_beyond(self, rows: int, bytes_: int) -> None:
        """Forget so many rows that the table alone had."""
        self.rows -= min(rows, self.beyond)
        self.bytes -= bytes_
        self._close()

    def _place(self, row: OutboxRow) -> None:
        """Insert a row; when the window is full, what comes after it is for the table."""
        if self.upto == HIGHEST and len(self.ids) >= self._window:
            self.upto = self.ids[self._window - 1]
        insort(self.ids, row.id)

    def _displace(self, row: OutboxRow) -> None:
        self.ids.pop(bisect_left(self.ids, row.id))

    def _go_beyond(self, first_s: float, last_s: float) -> None:
        self.first_s = min(self.first_s, first_s) if self.beyond else first_s
        self.last_s = max(self.last_s, last_s) if self.beyond else last_s

    def _close(self) -> None:
        if not self.beyond and self.upto > LOWEST and len(self.ids) < self._window:
            self.upto = HIGHEST
