"""The tables of commands: their latest phases, and which final results the broker does not have yet.

`starters.commands.ledger` decides what is deleted, and when; there is no limit of age or number here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields

from gateway.errors import DamagedError
from gateway.storage.database import Connection

# Begins the id under which a stop without one is stored: UNNAMED, the run, "/", the starter. It cannot be
# printed, so no client's id begins so.
UNNAMED = "\t"


@dataclass(frozen=True, slots=True)
class LedgerRow:
    """One command's latest phase. The fields are the columns, in their order."""

    client: str
    id: str
    starter: str
    verb: str
    phase: str
    code: str
    text: str
    time_s: float  # of the phase, UTC
    extra: str  # JSON: what else the result carries
    is_final: int  # 0 or 1
    may_be_written: int  # 0 or 1, and once 1 always so
    since_s: float  # of the command, UTC


_COLUMNS = tuple(field.name for field in fields(LedgerRow))
_TYPES = (str, str, str, str, str, str, str, float, str, int, int, float)
_UNCHANGED = ("client", "id", "may_be_written", "since_s")

_CREATE = """
    CREATE TABLE IF NOT EXISTS ledger (
        client TEXT NOT NULL, id TEXT NOT NULL, starter TEXT NOT NULL, verb TEXT NOT NULL,
        phase TEXT NOT NULL, code TEXT NOT NULL, text TEXT NOT NULL, time_s REAL NOT NULL,
        extra TEXT NOT NULL, is_final INTEGER NOT NULL, may_be_written INTEGER NOT NULL,
        since_s REAL NOT NULL, PRIMARY KEY (client, id)
    )
"""
_CREATE_UNDELIVERED = """
    CREATE TABLE IF NOT EXISTS untold (client TEXT NOT NULL, id TEXT NOT NULL, PRIMARY KEY (client, id))
"""
_SELECT = f"SELECT {', '.join(_COLUMNS)} FROM ledger ORDER BY rowid"
_PUT = f"""
    INSERT INTO ledger ({", ".join(_COLUMNS)}) VALUES ({", ".join("?" * len(_COLUMNS))})
    ON CONFLICT (client, id) DO UPDATE SET
    {", ".join(f"{name} = excluded.{name}" for name in _COLUMNS if name not in _UNCHANGED)},
    may_be_written = max(may_be_written, excluded.may_be_written)
"""
_SELECT_UNDELIVERED = "SELECT client, id FROM untold"
_PUT_UNDELIVERED = "INSERT OR IGNORE INTO untold (client, id) VALUES (?, ?)"
_FORGET_UNDELIVERED = "DELETE FROM untold WHERE client = ? AND id = ?"
_FORGET = "DELETE FROM ledger WHERE client = ? AND id = ?"
_FORGET_UNNAMED = "DELETE FROM ledger WHERE client = ? AND starter = ? AND substr(id, 1, 1) = ?"
_HARMLESS = "is_final AND (phase = 'rejected' OR verb IN ('read', 'stop'))"
_COUNT = f"SELECT count(*) FROM ledger WHERE {_HARMLESS}"
_FORGET_HARMLESS = f"""
    DELETE FROM ledger WHERE rowid IN (SELECT rowid FROM ledger WHERE {_HARMLESS} ORDER BY rowid LIMIT ?)
"""
_STRIP = """
    UPDATE ledger SET extra = '{}', text = substr(text, 1, 40) WHERE is_final
    AND (extra != '{}' OR length(text) > 40)
"""
_FORGET_UNKNOWN = """
    DELETE FROM untold WHERE NOT EXISTS
    (SELECT 1 FROM ledger WHERE ledger.client = untold.client AND ledger.id = untold.id)
"""


class LedgerTable:
    """The table; every row stays until `forget`, or until the file is full and the row harmless."""

    def create(self, connection: Connection) -> None:
        """Create the table when it is missing."""
        connection.execute(_CREATE)
        connection.execute(_CREATE_UNDELIVERED)
        connection.execute(f"{_SELECT} LIMIT 1")
        connection.execute(f"{_SELECT_UNDELIVERED} LIMIT 1")

    def make_room(self, connection: Connection) -> None:
        """Delete the older half of what may be repeated without harm; of what was acted on, keep the key."""
        (count,) = connection.execute(_COUNT).fetchone()
        if count:
            connection.execute(_FORGET_HARMLESS, (count // 2 + 1,))
            connection.execute(_FORGET_UNKNOWN)
        else:
            connection.execute(_STRIP)

    def put(self, connection: Connection, *, row: LedgerRow, is_undelivered: bool = False) -> None:
        """Store a row as its command's latest; `is_undelivered` until `mark_delivered`."""
        connection.execute(_PUT, astuple(row))
        if is_undelivered:
            connection.execute(_PUT_UNDELIVERED, (row.client, row.id))

    def forget(self, connection: Connection, *, keys: Sequence[tuple[str, str]]) -> None:
        """Delete the rows of these clients and ids; of a stop without an id, also those of earlier runs."""
        for client, id_ in keys:
            if id_.startswith(UNNAMED):
                connection.execute(_FORGET_UNNAMED, (client, id_.partition("/")[2], UNNAMED))
            else:
                connection.execute(_FORGET, (client, id_))
                connection.execute(_FORGET_UNDELIVERED, (client, id_))

    def mark_delivered(self, connection: Connection, *, client: str, id_: str) -> None:
        """Note that a command's final result has reached the broker."""
        connection.execute(_FORGET_UNDELIVERED, (client, id_))

    def undelivered(self, connection: Connection) -> frozenset[tuple[str, str]]:
        """Return the client and id of each command whose final result may not have reached the broker."""
        return frozenset((str(client), str(id_)) for client, id_ in connection.execute(_SELECT_UNDELIVERED))

    def rows(self, connection: Connection) -> list[LedgerRow]:
        """Return all rows, the oldest first; DamagedError when one is impossible."""
        rows = []
        for values in connection.execute(_SELECT):
            if not all(isinstance(value, kind) for value, kind in zip(values, _TYPES, strict=True)):
                raise DamagedError("a row of the ledger has a wrong type")
            rows.append(LedgerRow(*values))
        return rows
