"""The tables of the outbox's file: what waits for the broker, what it refused, and losses until declared."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Any

from gateway.errors import DamagedError
from gateway.storage.database import Connection
from gateway.storage.spool import Changes, Kind, Loss, Recalled, Refusal, Row, Share, SpoolPage

MOST_ROWS = 400_000
HIGHEST = 2**60  # no number is higher unless it is damaged
MOST_REFUSED = 100
SPARE = 100  # a full table drops one in so many rows more than it must, so that it is not full again at once
FULL, DAMAGED = "disk_full", "damaged"  # why something was lost
ROW_BYTES = 220  # what a row counts besides its topic and payload

_CREATE = (
    """
    CREATE TABLE IF NOT EXISTS spool (
        kind INTEGER NOT NULL, number INTEGER NOT NULL, boot TEXT NOT NULL, topic TEXT NOT NULL,
        payload BLOB NOT NULL, correlation BLOB, key TEXT NOT NULL, time_s REAL NOT NULL,
        checksum INTEGER NOT NULL, PRIMARY KEY (kind, number)
    ) WITHOUT ROWID
    """,
    """
    CREATE TABLE IF NOT EXISTS refused (
        number INTEGER PRIMARY KEY, time_s REAL NOT NULL, reason_code INTEGER NOT NULL, topic TEXT NOT NULL,
        payload BLOB NOT NULL
    )
    """,
    """
    CREATE TABLE IF NOT EXISTS loss (
        reason TEXT NOT NULL, kind INTEGER NOT NULL, count INTEGER NOT NULL, first_s REAL, last_s REAL,
        PRIMARY KEY (reason, kind)
    )
    """,
)
_ROWS = "SELECT number, kind, boot, topic, payload, correlation, key, time_s, checksum FROM spool"
_LOSSES = "SELECT reason, kind, count, first_s, last_s FROM loss"
_REFUSED = "SELECT time_s, reason_code, topic, payload FROM refused"
_PUT = """
    REPLACE INTO spool (number, kind, boot, topic, payload, correlation, key, time_s, checksum)
    VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)
"""
_PAGE = f"{_ROWS} WHERE kind = ? AND number > ? AND number < ? ORDER BY number LIMIT ?"
_SHARE = f"""
    SELECT count(*), coalesce(sum(length(topic) + length(payload) + {ROW_BYTES}), 0), min(time_s)
    FROM spool WHERE kind = ?
"""
_COUNT = "SELECT count(*) FROM spool WHERE kind = ?"
_OLDEST = "SELECT number FROM spool WHERE kind = ? ORDER BY number LIMIT 1 OFFSET ?"
_SPAN = "SELECT count(*), min(time_s), max(time_s) FROM spool WHERE kind = ? AND number <= ?"
_DROP = "DELETE FROM spool WHERE kind = ? AND number <= ?"
_FORGET = "DELETE FROM spool WHERE kind = ? AND number = ?"
_PUT_LOSS = """
    INSERT INTO loss (reason, kind, count, first_s, last_s) VALUES (?, ?, ?, ?, ?)
    ON CONFLICT (reason, kind) DO UPDATE SET count = count + excluded.count,
    first_s = coalesce(min(first_s, excluded.first_s), first_s, excluded.first_s),
    last_s = coalesce(max(last_s, excluded.last_s), last_s, excluded.last_s)
"""
_PUT_REFUSED = "INSERT INTO refused (time_s, reason_code, topic, payload) VALUES (?, ?, ?, ?)"
_FORGET_REFUSED = """
    DELETE FROM refused WHERE number <= (SELECT number FROM refused ORDER BY number DESC LIMIT 1 OFFSET ?)
"""


class OutboxTable:
    """The tables; numbers are the file's own. When there are too many rows values go first, results last."""

    def __init__(self, *, most_rows: int = MOST_ROWS) -> None:
        self._most_rows = most_rows
        self._room = 0  # rows that may be put before they are counted again
        self._made_room: list[Loss] = []

    def create(self, connection: Connection) -> None:
        """Create the tables when they are missing."""
        self._room = 0
        for sql in _CREATE:
            connection.execute(sql)
        for sql in (_ROWS, _LOSSES, _REFUSED):
            connection.execute(f"{sql} LIMIT 1")

    def make_room(self, connection: Connection) -> None:
        """Delete the tenth that matters least."""
        self._made_room += self._drop(connection, sum(_counts(connection)) // 10 + 1)

    def take_made_room(self) -> tuple[Loss, ...]:
        """Return what `make_room` has deleted since the last time; it is noted as lost already."""
        losses, self._made_room = self._made_room, []
        return tuple(losses)

    def recall(self, connection: Connection) -> tuple[int, Recalled]:
        """Return the highest number, and how much there is; DamagedError when they are impossible."""
        (highest,) = connection.execute("SELECT coalesce(max(number), 0) FROM spool").fetchone()
        if not isinstance(highest, int) or not 0 <= highest <= HIGHEST:
            raise DamagedError("a row of the outbox has no number")
        shares = {}
        for kind in Kind:
            rows, size, first_s = connection.execute(_SHARE, (kind,)).fetchone()
            shares[kind] = Share(rows, int(size), _time(first_s) or 0.0)
        keys = connection.execute("SELECT key FROM spool WHERE key != ''")
        losses = [
            Loss(str(reason), Kind(kind), rows, _time(first_s), _time(last_s))
            for reason, kind, rows, first_s, last_s in connection.execute(_LOSSES)
            if kind in tuple(Kind) and isinstance(rows, int)
        ]
        return highest, Recalled(shares, frozenset(str(key) for (key,) in keys), tuple(losses))

    def apply(self, connection: Connection, changes: Changes) -> tuple[Loss, ...]:
        """Do what `changes` say; return what had to be dropped for it."""
        if changes.are_losses_declared:
            connection.execute("DELETE FROM loss")
        connection.executemany(_FORGET, changes.gone)
        connection.executemany(_PUT, [(*row, _checksum(row)) for row in changes.rows])
        connection.executemany(_PUT_LOSS, [loss[:5] for loss in changes.losses])
        if changes.refusals:
            connection.executemany(_PUT_REFUSED, changes.refusals)
            connection.execute(_FORGET_REFUSED, (MOST_REFUSED,))
        self._room -= len(changes.rows)
        return self._trim(connection) if self._room < 0 else ()

    def page(self, connection: Connection, *, kind: Kind, after: int, before: int, most: int) -> SpoolPage:
        """Return the rows of a kind between two numbers; those that are damaged are deleted and declared."""
        found = connection.execute(_PAGE, (kind, after, before, most + 1)).fetchall()
        is_last = len(found) <= most
        del found[most:]
        rows = [Row(*columns[:-1])._replace(kind=kind) for columns in found]
        is_whole = [_checksum(row) == columns[-1] for row, columns in zip(rows, found, strict=True)]
        damaged = [row.number for row, is_good in zip(rows, is_whole, strict=True) if not is_good]
        losses = [Loss(DAMAGED, kind, len(damaged), None, None)] if damaged else []
        connection.executemany(_FORGET, [(kind, number) for number in damaged])
        connection.executemany(_PUT_LOSS, [loss[:5] for loss in losses])
        good = tuple(row for row, is_good in zip(rows, is_whole, strict=True) if is_good)
        return SpoolPage(good, is_last=is_last, losses=tuple(losses))

    def refused(self, connection: Connection) -> list[Refusal]:
        """Return what the broker refused, the oldest first."""
        return [Refusal(*columns) for columns in connection.execute(f"{_REFUSED} ORDER BY number")]

    def _trim(self, connection: Connection) -> tuple[Loss, ...]:
        excess = sum(_counts(connection)) - self._most_rows
        losses = self._drop(connection, excess + self._most_rows // SPARE) if excess > 0 else ()
        self._room = sum(loss.rows for loss in losses) - excess
        return losses

    def _drop(self, connection: Connection, excess: int) -> tuple[Loss, ...]:
        """Delete so many rows, those that matter least, and note that they are lost."""
        losses: list[Loss] = []
        for kind, count in zip(Kind, _counts(connection), strict=True):
            if take := min(count, excess):
                (upto,) = connection.execute(_OLDEST, (kind, take - 1)).fetchone()
                rows, first_s, last_s = connection.execute(_SPAN, (kind, upto)).fetchone()
                connection.execute(_DROP, (kind, upto))
                losses.append(Loss(FULL, kind, rows, _time(first_s), _time(last_s), upto))
                excess -= take
        connection.executemany(_PUT_LOSS, [loss[:5] for loss in losses])
        return tuple(losses)


def _counts(connection: Connection) -> Sequence[int]:
    return [connection.execute(_COUNT, (kind,)).fetchone()[0] for kind in Kind]


def _checksum(row: Row) -> int:
    return zlib.crc32(repr((int(row.kind), *row[:1], *row[2:])).encode("utf-8", "backslashreplace"))


def _time(value: Any) -> float | None:
    """Return a time that was read, None for what is none."""
    return value if isinstance(value, float) else None
