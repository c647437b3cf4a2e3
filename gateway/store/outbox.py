"""Messages that wait for the broker: one row each, from the moment it is put until the broker has it.

Ids rise, and within a rank they are the order. A run counts its own rows from 1, so that an id is known
before anything is written; the table adds the highest id of earlier runs, whose rows are 0 and below for
this run. A row has a checksum: one that is damaged is lost and declared, never published. Losses that are
not declared yet stand in a table of their own, changed in the transaction that makes the loss.
Memory decides which rows are lost when there are too many.

Rank and id are one number, the key: then a row is written into one page of one B-tree, and what is added at
the end of a rank fills its pages.
"""

from __future__ import annotations

import enum
import zlib
from collections.abc import Collection, Iterable, Sequence
from typing import Any, NamedTuple

from gateway.errors import DamagedError
from gateway.store.database import Connection

ROW_BYTES = 220  # what a row costs besides its topic and payload, in memory and on the disk
ID_BITS = 56
LATEST_S = 2**33

_COLUMNS = "topic, payload, time_s, boot, key, correlation, checksum"
_INSERT = f"INSERT INTO outbox (place, {_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT DO NOTHING"
_DELETE = "DELETE FROM outbox WHERE place = ?"
_PAGE = f"SELECT id, rank, {_COLUMNS} FROM outbox WHERE place > ? AND place < ? ORDER BY place LIMIT ?"
_LAST = "SELECT coalesce(max(place), 0) FROM outbox WHERE place < ?"
_SIZE = f"length(topic) + length(payload) + {ROW_BYTES}"
_TIME = f"max(min(time_s, {LATEST_S}), 0.0)"  # also where that is damaged
_TOTALS = f"""
    SELECT rank, count(*), sum({_SIZE}), min({_TIME}), max({_TIME}) FROM outbox WHERE id <= ? GROUP BY rank
"""
_KEYS = "SELECT key FROM outbox WHERE id <= ? AND key != '' ORDER BY id"
_LOSSES = "SELECT reason, rank, rows, first_s, last_s FROM outbox_losses"
_ADD_LOSS = "INSERT INTO outbox_losses VALUES (?, ?, ?, ?, ?)"


class Rank(enum.IntEnum):
    """The kind of a row; a full outbox gives up the first of these first."""

    VALUE = 0  # one item of a history
    EVENT = 1  # an event, a start, or an entry of the audit
    RESULT = 2  # a result, or a trip


class OutboxRow(NamedTuple):
    """One message that the broker has not acknowledged."""

    id: int
    rank: Rank
    topic: str
    payload: bytes
    time_s: float  # when it was put: UTC in the table, the steady clock's in memory
    boot: str  # the run that it belongs to
    key: str  # names what must be published once, such as a final result ("client/id"); else empty
    correlation: bytes | None = None  # MQTT 5 alone

    @property
    def size(self) -> int:
        """Return what the row costs, in bytes."""
        return len(self.topic) + len(self.payload) + ROW_BYTES


class Total(NamedTuple):
    """How much there is of one rank; the times are UTC."""

    rows: int
    bytes: int
    first_s: float
    last_s: float


class Loss(NamedTuple):
    """Rows that will never be published; the times are UTC."""

    reason: str
    rank: Rank
    rows: int
    first_s: float
    last_s: float


class OutboxPage(NamedTuple):
    """The next rows of a rank, in order."""

    rows: Sequence[OutboxRow]
    upto: int  # the rank is read up to this id
    is_last: bool  # nothing comes after it


class OutboxTable:
    """The rows of one file; every call is made within a transaction, in the thread of the file."""

    def __init__(self) -> None:
        self._earlier: int | None = None  # the highest id of earlier runs

    def insert(self, connection: Connection, rows: Iterable[OutboxRow]) -> None:
        """Write rows, whose times are UTC; those that are there already stay as they are."""
        base = self._base(connection)
        stored = (row._replace(id=row.id + base) for row in rows)
        connection.executemany(
            _INSERT, ((_place(row.rank, row.id), *row[2:], _checksum(row)) for row in stored)
        )

    def delete(self, connection: Connection, ids: Iterable[tuple[Rank, int]]) -> None:
        """Delete rows; those that are not there do not matter."""
        base = self._base(connection)
        connection.executemany(_DELETE, ((_place(rank, id_ + base),) for rank, id_ in ids))

    def page(self, connection: Connection, rank: Rank, after: int, limit: int) -> OutboxPage:
        """Return the rows of a rank after an id, the oldest first."""
        base = self._base(connection)
        span = _place(rank, max(after + base, 0)), _place(rank + 1, 0)
        rows = [_row(*columns, base=base) for columns in connection.execute(_PAGE, (*span, limit))]
        return OutboxPage(rows, rows[-1].id if rows else after, is_last=len(rows) < limit)

    def totals(self, connection: Connection) -> dict[Rank, Total]:
        """Return how much earlier runs have left of each rank; reads the whole table."""
        found = connection.execute(_TOTALS, (self._base(connection),))
        return {Rank(rank): Total(*columns) for rank, *columns in found}

    def keys(self, connection: Connection) -> list[str]:
        """Return the keys of what earlier runs have left, the oldest first."""
        return [key for (key,) in connection.execute(_KEYS, (self._base(connection),))]

    def payloads(self, connection: Connection, keys: Collection[str]) -> dict[str, bytes]:
        """Return what is published with these keys; reads the whole table."""
        wanted = f"SELECT id, rank, {_COLUMNS} FROM outbox WHERE key IN ({', '.join('?' * len(keys))})"
        rows = (_row(*columns, base=0) for columns in connection.execute(wanted, tuple(keys)))
        return {row.key: row.payload for row in rows}

    def losses(self, connection: Connection) -> list[Loss]:
        """Return the losses that are not declared yet."""
        return [Loss(reason, Rank(rank), *columns) for reason, rank, *columns in connection.execute(_LOSSES)]

    def set_losses(self, connection: Connection, losses: Iterable[Loss]) -> None:
        """Let these be the losses that are not declared yet."""
        connection.execute("DELETE FROM outbox_losses")
        connection.executemany(_ADD_LOSS, losses)

    def _base(self, connection: Connection) -> int:
        if self._earlier is None:
            last = (connection.execute(_LAST, (_place(rank + 1, 0),)).fetchone()[0] for rank in Rank)
            self._earlier = max(place % 2**ID_BITS for place in last)
        return self._earlier


def _place(rank: int, id_: int) -> int:
    return (rank << ID_BITS) + id_


def _row(id_: int, rank: int, *columns: Any, base: int) -> OutboxRow:
    *of_row, checksum = columns
    row = OutboxRow(id_, Rank(rank), *of_row)
    if _checksum(row) != checksum:
        raise DamagedError("a message in it is damaged")
    return row._replace(id=id_ - base)


def _checksum(row: OutboxRow) -> int:
    return zlib.crc32(repr((int(row.rank), row.id, *row[2:])).encode("utf-8", "backslashreplace"))


def merged(losses: Iterable[Loss]) -> list[Loss]:
    """Return one loss for each reason and rank."""
    sums: dict[tuple[str, Rank], Loss] = {}
    for loss in losses:
        place = (loss.reason, loss.rank)
        before = sums.get(place, loss._replace(rows=0))
        sums[place] = Loss(
            *place,
            before.rows + loss.rows,
            min(before.first_s, loss.first_s),
            max(before.last_s, loss.last_s),
        )
    return list(sums.values())
