"""What waits for the broker: one row a message, from the moment it is put until the broker has it.

Ids rise, and within a rank they are the order. A run counts its own rows from 1, so that an id is known
before anything is written; the table adds the highest id of earlier runs, whose rows are 0 and below for
this run. A row has a checksum: one that is damaged is deleted and declared, never published. Losses that are
not declared yet stand in a table of their own, changed in the transaction that makes the loss.
"""

from __future__ import annotations

import enum
import zlib
from collections.abc import Collection, Iterable, Sequence, Set
from typing import NamedTuple

from gateway.store.database import Connection

ROW_BYTES = 220  # what a row costs besides its topic and payload, in memory and on the disk
SPARE = 50  # a full table gives up one in so many of its rows and bytes, so that it is not full again at once
DISK_FULL, DAMAGED = "disk_full", "damaged"  # why something was lost

TABLES = (
    """
    CREATE TABLE outbox (
        rank INTEGER NOT NULL, id INTEGER NOT NULL, topic TEXT NOT NULL, payload BLOB NOT NULL,
        time_s REAL NOT NULL, boot TEXT NOT NULL, key TEXT NOT NULL, correlation BLOB,
        checksum INTEGER NOT NULL, PRIMARY KEY (rank, id)
    ) WITHOUT ROWID
    """,
    """
    CREATE TABLE outbox_losses (
        reason TEXT NOT NULL, rank INTEGER NOT NULL, rows INTEGER NOT NULL, first_s REAL NOT NULL,
        last_s REAL NOT NULL, PRIMARY KEY (reason, rank)
    )
    """,
)
_INSERT = "INSERT INTO outbox VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT DO NOTHING"
_DELETE = "DELETE FROM outbox WHERE rank = ? AND id = ?"
_PAGE = "SELECT * FROM outbox WHERE rank = ? AND id > ? ORDER BY id LIMIT ?"
_SIZE = f"length(topic) + length(payload) + {ROW_BYTES}"
_TOTALS = f"SELECT rank, count(*), sum({_SIZE}), min(time_s), max(time_s) FROM outbox GROUP BY rank"
_OLDEST = f"SELECT id, {_SIZE}, time_s FROM outbox WHERE rank = ? ORDER BY id"
_ADD_LOSS = """
    INSERT INTO outbox_losses VALUES (?, ?, ?, ?, ?) ON CONFLICT DO UPDATE SET rows = rows + excluded.rows,
    first_s = min(first_s, excluded.first_s), last_s = max(last_s, excluded.last_s)
"""


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


class Deleted(NamedTuple):
    """A row that the table had to give up; its time is UTC."""

    rank: Rank
    id: int
    size: int
    time_s: float


class Loss(NamedTuple):
    """Rows that will never be published; the times are UTC."""

    reason: str
    rank: Rank
    rows: int
    first_s: float
    last_s: float


class Page(NamedTuple):
    """The next rows of a rank, in order."""

    rows: Sequence[OutboxRow]
    upto: int  # the rank is read up to this id
    is_last: bool  # nothing comes after it
    damaged: Sequence[Deleted]


class OutboxTable:
    """The rows of one file; every call is made within a transaction, in the thread of the file."""

    def __init__(self, *, most_rows: int = 400_000, most_bytes: int = 48 * 2**20) -> None:
        self._most_rows = most_rows
        self._most_bytes = most_bytes
        self._rows_left = self._bytes_left = 0  # that may be inserted before it is counted what there is
        self._earlier: int | None = None  # the highest id of earlier runs

    def insert(self, connection: Connection, rows: Iterable[OutboxRow]) -> None:
        """Write rows, whose times are UTC; those that are there already stay as they are."""
        base = self._base(connection)
        for row in rows:
            stored = row._replace(id=row.id + base)
            connection.execute(_INSERT, (row.rank, stored.id, *row[2:], _checksum(stored)))
            self._rows_left -= 1
            self._bytes_left -= row.size

    def delete(self, connection: Connection, ids: Iterable[tuple[Rank, int]]) -> None:
        """Delete rows; those that are not there do not matter."""
        base = self._base(connection)
        connection.executemany(_DELETE, ((rank, id_ + base) for rank, id_ in ids))

    def page(self, connection: Connection, rank: Rank, after: int, limit: int) -> Page:
        """Return the rows of a rank after an id, the oldest first; damaged ones are deleted."""
        base = self._base(connection)
        found = connection.execute(_PAGE, (rank, after + base, limit)).fetchall()
        rows: list[OutboxRow] = []
        damaged: list[Deleted] = []
        for _, id_, *columns, checksum in found:
            row = OutboxRow(id_, rank, *columns)
            if _checksum(row) == checksum:
                rows.append(row._replace(id=id_ - base))
            else:
                damaged.append(Deleted(rank, id_ - base, row.size, _time(row.time_s)))
        self._give_up(connection, DAMAGED, damaged)
        upto = found[-1][1] - base if found else after
        return Page(rows, upto, is_last=len(found) < limit, damaged=damaged)

    def totals(self, connection: Connection) -> dict[Rank, Total]:
        """Return how much there is of each rank of which there is something; reads the whole table."""
        found = {rank: Total(*columns) for rank, *columns in connection.execute(_TOTALS)}
        return {rank: found[rank] for rank in Rank if rank in found}

    def keys(self, connection: Connection) -> list[str]:
        """Return the keys of all rows that have one, the oldest first."""
        return [key for (key,) in connection.execute("SELECT key FROM outbox WHERE key != '' ORDER BY id")]

    def payloads(self, connection: Connection, keys: Collection[str]) -> dict[str, bytes]:
        """Return what is published with these keys, but of rows that are damaged; reads the whole table."""
        wanted = f"SELECT * FROM outbox WHERE key IN ({', '.join('?' * len(keys))})"
        found = connection.execute(wanted, tuple(keys))
        rows = ((OutboxRow(id_, Rank(rank), *columns), checksum) for rank, id_, *columns, checksum in found)
        return {row.key: row.payload for row, checksum in rows if _checksum(row) == checksum}

    def losses(self, connection: Connection) -> list[Loss]:
        """Return the losses that are not declared yet."""
        found = connection.execute("SELECT * FROM outbox_losses")
        return [Loss(reason, Rank(rank), *columns) for reason, rank, *columns in found]

    def set_losses(self, connection: Connection, losses: Iterable[Loss]) -> None:
        """Let these be the losses that are not declared yet."""
        connection.execute("DELETE FROM outbox_losses")
        connection.executemany(_ADD_LOSS, losses)

    def trim(self, connection: Connection, keep: Set[int]) -> list[Deleted]:
        """Delete the oldest rows of the lowest ranks when there is too much, and note them as lost.

        Rows to `keep` are not deleted, and do not count: no result goes because of values that must stay.
        """
        if self._rows_left >= 0 and self._bytes_left >= 0:
            return []
        base, totals = self._base(connection), self.totals(connection).values()
        self._rows_left = self._most_rows + len(keep) - sum(total.rows for total in totals)
        self._bytes_left = self._most_bytes - sum(total.bytes for total in totals)
        if self._rows_left >= 0 and self._bytes_left >= 0:
            return []
        deleted = []
        for rank in Rank:
            for id_, size, time_s in connection.execute(_OLDEST, (rank,)):
                is_spare = self._rows_left >= self._most_rows // SPARE
                if is_spare and self._bytes_left >= self._most_bytes // SPARE:
                    break
                if id_ - base not in keep:
                    deleted.append(Deleted(rank, id_ - base, size, _time(time_s)))
                    self._rows_left += 1
                    self._bytes_left += size
        self._give_up(connection, DISK_FULL, deleted)
        return deleted

    def _give_up(self, connection: Connection, reason: str, rows: Sequence[Deleted]) -> None:
        self.delete(connection, ((row.rank, row.id) for row in rows))
        connection.executemany(_ADD_LOSS, losses_of(reason, rows))

    def _base(self, connection: Connection) -> int:
        if self._earlier is None:
            (self._earlier,) = connection.execute("SELECT coalesce(max(id), 0) FROM outbox").fetchone()
        return self._earlier


def losses_of(reason: str, rows: Iterable[Deleted]) -> list[Loss]:
    """Return what is lost with these rows, summed up by rank."""
    return merged(Loss(reason, row.rank, 1, row.time_s, row.time_s) for row in rows)


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


def _time(value: object) -> float:
    """Return a time that was read; what is damaged may have none."""
    return value if isinstance(value, float) else 0.0
