"""What waits for the thread of a database: pieces of work in two ranks, and the newest piece of each key.

1. Urgent pieces come first, and take some with a key along; then all others, in batches.
2. A piece with a key waits until it is done: a failure of the disk does not end it, and newer work of its key
   gets its place and its future. Of each table a bounded number of keys waits, the newest.
"""

from __future__ import annotations

import threading
from collections import defaultdict, deque
from collections.abc import Iterable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from itertools import chain, islice
from typing import Any

from gateway.errors import StoreError
from gateway.store.database import Work

MOST_WAITING = 10_000  # pieces without a key; and keys of a table
MOST_AT_ONCE = 500  # pieces in one transaction
MOST_ALONG = 100  # pieces with a key that urgent ones take along: a transaction of their own costs 8 KiB

Key = tuple[str, ...]  # the table, and what names the row


@dataclass(slots=True, eq=False)
class Piece:
    """Some work and its answer."""

    work: Work
    key: Key | None = None
    is_urgent: bool = False
    is_flushed: bool = True
    is_freeing: bool = False
    is_begun: bool = False
    future: Future[Any] = field(default_factory=Future)

    def begin(self) -> bool:
        """Return whether it is to be done: its caller has not given it up meanwhile."""
        if not self.is_begun:
            self.is_begun = self.future.set_running_or_notify_cancel()
        return self.is_begun and not self.future.done()


class Waiting:
    """`put` is the app's; all other calls are made in the thread."""

    def __init__(self, most_keys: int = MOST_WAITING) -> None:
        self._urgent: deque[Piece] = deque()  # those with a key are among the keyed ones too
        self._others: deque[Piece] = deque()
        self._keyed: defaultdict[str, dict[Key, Piece]] = defaultdict(dict)  # by table, the oldest first
        self._most_keys = most_keys
        self._lock = threading.Lock()  # of the keyed ones

    @property
    def keyed(self) -> int:
        """Return how many pieces with a key wait."""
        return sum(map(len, self._keyed.values()))

    @property
    def urgent(self) -> int:
        """Return how many urgent pieces wait."""
        return len(self._urgent)

    def put(self, piece: Piece) -> Future[Any]:
        """Let a piece wait; the future fails at once when there are too many without a key."""
        if piece.key is not None:
            piece = self._keep(piece, piece.key)
        elif len(self._urgent) + len(self._others) >= MOST_WAITING:
            piece.future.set_exception(StoreError("too much is waiting for the disk"))
            return piece.future
        if piece.is_urgent or piece.key is None:
            self._rank(piece).append(piece)
        return piece.future

    def take(self, *, is_away: bool) -> list[Piece] | None:
        """Return the next pieces, None when there are none; while the file is away keys wait on."""
        urgent = _taken(self._urgent, MOST_AT_ONCE)
        most = MOST_ALONG if urgent else MOST_AT_ONCE
        with self._lock:
            tables = (table.values() for table in self._keyed.values())
            keyed = [] if is_away else list(islice(chain.from_iterable(tables), most))
        others = [] if urgent else _taken(self._others, MOST_AT_ONCE - len(keyed))
        found = dict.fromkeys((*urgent, *keyed, *others))
        return [piece for piece in found if piece.begin()] if found else None

    def put_back(self, pieces: Sequence[Piece]) -> None:
        """Let pieces for which there was no time wait again, in their places."""
        for piece in reversed(pieces):
            if not piece.future.done() and (piece.is_urgent or piece.key is None):
                self._rank(piece).appendleft(piece)

    def end(self, piece: Piece, work: Work, answer: Any = None, error: StoreError | None = None) -> None:
        """Note that work is on the disk, or never will be; newer work of its key may have come meanwhile."""
        if piece.key is not None:
            with self._lock:
                table = self._keyed[piece.key[0]]
                if table.get(piece.key) is not piece or piece.work is not work:
                    return
                del table[piece.key]
        if error is None:
            piece.future.set_result(answer)
        else:
            piece.future.set_exception(error)

    def fail(self, pieces: Iterable[Piece], error: StoreError) -> None:
        """Note that nothing can be stored now: those without a key have failed."""
        for piece in pieces:
            if piece.key is None:
                piece.future.set_exception(error)

    def _keep(self, piece: Piece, key: Key) -> Piece:
        with self._lock:
            table = self._keyed[key[0]]
            if key in table:
                table[key].work, table[key].is_urgent = piece.work, piece.is_urgent
            piece = table.setdefault(key, piece)
            piece.begin()  # its future cannot be cancelled
            oldest = table.pop(next(iter(table))) if len(table) > self._most_keys else None
        if oldest is not None:
            oldest.future.set_exception(StoreError("too much is waiting for the disk"))
        return piece

    def _rank(self, piece: Piece) -> deque[Piece]:
        return self._urgent if piece.is_urgent else self._others


def _taken(pieces: deque[Piece], most: int) -> list[Piece]:
    return [pieces.popleft() for _ in range(min(len(pieces), most))]
