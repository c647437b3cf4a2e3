"""What waits for the broker: one row a message, from the moment it is put until the broker has it.

Ids rise, and within a rank they are the order. A run counts its own rows from 1, so that an id is known
before anything is written; the table adds the highest id of earlier runs, whose rows are 0 and below for
this run. A row has a checksum: one that is damaged is lost and declared, never published. Losses that are
not declared yet stand in a table of their own, changed in the transaction that makes the loss.
What is lost when there is too much is decided in memory.

Rank and id are one number, the key: then a row is written into one page of one B-tree, and what is added at
the end of a rank fills its pages.
"""

from __future__ import annotations

import enum
import zlib
from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

from gateway.store.database import Connection

ROW_BYTES = 220  # what a row costs besides its topic and payload, in memory and on the disk
ID_BITS = 56
LATEST_S = 2**33  # of the times that a sound row may have

TABLES = (
    f"""
    CREATE TABLE outbox (
        place INTEGER PRIMARY KEY, topic TEXT NOT NULL, payload BLOB NOT NULL, time_s REAL NOT NULL,
        boot TEXT NOT NULL, key TEXT NOT NULL, correlation BLOB, checksum INTEGER NOT NULL,
        rank INTEGER AS (place >> {ID_BITS}), id INTEGER AS (place & {2**ID_BITS - 1})
    )
    """,
    """
    CREATE TABLE outbox_losses (
        reason TEXT NOT NULL, rank INTEGER NOT NULL, rows INTEGER NOT NULL, first_s REAL NOT NULL,
        last_s REAL NOT NULL, PRIMARY KEY (reason, rank)
    )
    """,
)
_COLUMNS = "topic, payload, time_s, boot, key, correlation, checksum"
_INSERT = f"INSERT INTO outbox (place, {_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT DO NOTHING"
_DELETE = "DELETE FROM outbox WHERE place = ?"
_PAGE = f"SELECT id, {_COLUMNS} FROM outbox WHERE place > ? AND place < ? ORDER BY place LIMIT ?"
_LAST = "SELECT coalesce(max(place), 0) FROM outbox WHERE place < ?"
_SIZE = f"length(topic) + length(payload) + {ROW_BYTES}"
_TIME = f"CASE WHEN time_s BETWEEN 0 AND {LATEST_S} THEN time_s END"  # a damaged one is none
_TOTALS = f"""
    SELECT rank, count(*), coalesce(sum({_SIZE}), 0), coalesce(min({_TIME}), 0.0), coalesce(max({_TIME}), 0.0)
    FROM outbox WHERE id <= ? GROUP BY rank
"""
_KEYS = "SELECT CAST(key AS TEXT) FROM outbox WHERE id <= ? AND key != '' ORDER BY id"
_LOSSES = f"""
    SELECT CAST(reason AS TEXT), rank, rows, first_s, last_s FROM outbox_losses
    WHERE rank IN (0, 1, 2) AND typeof(rows) = 'integer'
    AND first_s BETWEEN 0 AND {LATEST_S} AND last_s BETWEEN 0 AND {LATEST_S}
"""
_ADD_LOSS = "INSERT INTO outbox_losses VALUES (?, ?, ?, ?, ?)"


class Rank(enum.IntEnum):
    """What a row holds; a full outbox gives up the first of these first."""

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
    damaged: Sequence[int]  # the ids of rows of which nothing else is certain
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
        values = ((_place(row.rank, row.id), *row[2:], _checksum(row)) for row in stored)
        connection.executemany(_INSERT, values)

    def delete(self, connection: Connection, ids: Iterable[tuple[Rank, int]]) -> None:
        """Delete rows; those that are not there do not matter."""
        base = self._base(connection)
        connection.executemany(_DELETE, ((_place(rank, id_ + base),) for rank, id_ in ids))

    def page(self, connection: Connection, rank: Rank, after: int, limit: int) -> OutboxPage:
        """Return the rows of a rank after an id, the oldest first."""
        base = self._base(connection)
        end = _place(rank, max(after + base, 0)), _place(rank + 1, 0)
        found = connection.execute(_PAGE, (*end, limit)).fetchall()
        rows: list[OutboxRow] = []
        damaged: list[int] = []
        for id_, *columns, checksum in found:
            row = OutboxRow(id_, rank, *columns)
            if _checksum(row) == checksum:
                rows.append(row._replace(id=id_ - base))
            else:
                damaged.append(id_ - base)
        upto = found[-1][0] - base if found else after
        return OutboxPage(rows, damaged, upto, is_last=len(found) < limit)

    def totals(self, connection: Connection) -> dict[Rank, Total]:
        """Return how much earlier runs have left of each rank; reads the whole table."""
        found = connection.execute(_TOTALS, (self._base(connection),))
        totals = {rank: Total(*columns) for rank, *columns in found}
        return {rank: totals[rank] for rank in Rank if rank in totals}

    def keys(self, connection: Connection) -> list[str]:
        """Return the keys of what earlier runs have left, the oldest first."""
        return [key for (key,) in connection.execute(_KEYS, (self._base(connection),))]

    def payloads(self, connection: Connection, keys: Collection[str]) -> dict[str, bytes]:
        """Return what is published with these keys, but of rows that are damaged; reads the whole table."""
        wanted = f"SELECT id, rank, {_COLUMNS} FROM outbox WHERE key IN ({', '.join('?' * len(keys))})"
        found = connection.execute(wanted, tuple(keys))
        rows = ((OutboxRow(*columns), checksum) for *columns, checksum in found)
        return {row.key: row.payload for row, checksum in rows if _checksum(row) == checksum}

    def losses(self, connection: Connection) -> list[Loss]:
        """Return the losses that are not declared yet, but those that are damaged."""
        found = connection.execute(_LOSSES)
        return [Loss(reason, Rank(rank), *columns) for reason, rank, *columns in found]

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


def _checksum(row: OutboxRow) -> int:
    return zlib.crc32(repr((int(row.rank), row.id, *row[2:])).encode("utf-8", "backslashreplace"))
