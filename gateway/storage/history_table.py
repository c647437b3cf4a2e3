"""The table of the history: rows of a kind for each starter, of which the newest few stay.

A row's data is a JSON object, compressed: a curve of 300 samples takes about 4 KB. The compression carries a
checksum (RFC 1950), so a corrupted row is noticed when it is read, and left out.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from gateway.store import Connection

_SELECT = "SELECT starter, kind, id, time_s, data FROM history"
_PUT = """
    INSERT INTO history (starter, kind, id, time_s, data) VALUES (?, ?, ?, ?, ?)
    ON CONFLICT (starter, kind, id) DO UPDATE SET time_s = excluded.time_s, data = excluded.data
"""
_PRUNE = """
    DELETE FROM history WHERE starter = ? AND kind = ? AND number <=
    (SELECT number FROM history WHERE starter = ? AND kind = ? ORDER BY number DESC LIMIT 1 OFFSET ?)
"""
_FORGET = "DELETE FROM history WHERE starter = ? AND kind = ? AND id = ?"


_WINDOW_BITS, _MEMORY_LEVEL = 13, 6  # 64 KB of memory instead of 256 KB, for 2 % more on disk
GONE = 0


class HistoryRow(NamedTuple):
    """What is stored of a starter under a kind and an id, in place of what was there."""

    starter: str
    kind: str
    id: str
    time_s: float  # UTC
    data: Mapping[str, Any]
    limit: int = 1  # so many of this kind stay, the newest; GONE: this one goes


class HistoryTable:
    """The table; the order of rows is that in which they came first, whatever the wall clock said."""

    def put(self, connection: Connection, *, rows: Sequence[HistoryRow]) -> None:
        """Store rows, and delete those that are too many or to go."""
        for row in rows:
            if row.limit == GONE:
                connection.execute(_FORGET, row[:3])
                continue
            connection.execute(_PUT, (*row[:4], _packed(row.data)))
            connection.execute(_PRUNE, (row.starter, row.kind, row.starter, row.kind, row.limit))

    def rows(
        self, connection: Connection, *, starters: Sequence[str] | None = None, kinds: Sequence[str] = ()
    ) -> list[HistoryRow]:
        """Return the rows of these starters (None: all) and kinds (none: all), the oldest first."""
        wanted: list[str] = []
        values: list[str] = []
        for column, names in (("starter", starters), ("kind", kinds or None)):
            if names is not None:
                wanted.append(f"{column} IN ({', '.join('?' * len(names))})")
                values += names
        where = f" WHERE {' AND '.join(wanted)}" if wanted else ""
        found = connection.execute(f"{_SELECT}{where} ORDER BY number", values)
        rows = (_row(columns) for columns in found)
        return [row for row in rows if row is not None]

    def row(self, connection: Connection, *, starter: str, kind: str, id_: str) -> HistoryRow | None:
        """Return one row; None when there is none, or none that can be read."""
        sql = f"{_SELECT} WHERE starter = ? AND kind = ? AND id = ?"
        columns = connection.execute(sql, (starter, kind, id_)).fetchone()
        return None if columns is None else _row(columns)


def _packed(data: Mapping[str, Any]) -> bytes:
    packer = zlib.compressobj(zlib.Z_DEFAULT_COMPRESSION, zlib.DEFLATED, _WINDOW_BITS, _MEMORY_LEVEL)
    return packer.compress(json.dumps(data, separators=(",", ":")).encode()) + packer.flush()


def _row(columns: tuple[Any, ...]) -> HistoryRow | None:
    """Return a row as it was put; None for one that is damaged."""
    starter, kind, id_, time_s, packed = columns
    try:
        data = json.loads(zlib.decompress(packed))
    except (zlib.error, ValueError, TypeError):
        return None
    is_whole = isinstance(data, dict) and isinstance(time_s, float)
    return HistoryRow(str(starter), str(kind), str(id_), time_s, data) if is_whole else None
