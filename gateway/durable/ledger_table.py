"""The commands in the store: which they were, what became of them, and whose end nobody has heard of yet."""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields

from gateway.database import Connection
from gateway.errors import DamagedError

MOST_ROWS = 10_000
LONGEST_S = 7 * 24 * 3600.0
LEAST_ROWS = 200  # stay whatever the clock says: one that is set at last makes everything look old
PRUNED_EVERY = 50  # writes


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
_KEPT = ("client", "id", "may_be_written", "since_s")

_CREATE = """
    CREATE TABLE IF NOT EXISTS ledger (
        client TEXT NOT NULL, id TEXT NOT NULL, starter TEXT NOT NULL, verb TEXT NOT NULL,
        phase TEXT NOT NULL, code TEXT NOT NULL, text TEXT NOT NULL, time_s REAL NOT NULL,
        extra TEXT NOT NULL, is_final INTEGER NOT NULL, may_be_written INTEGER NOT NULL,
        since_s REAL NOT NULL, PRIMARY KEY (client, id)
    )
"""
_CREATE_UNTOLD = """
    CREATE TABLE IF NOT EXISTS untold (client TEXT NOT NULL, id TEXT NOT NULL, PRIMARY KEY (client, id))
"""
_SELECT = f"SELECT {', '.join(_COLUMNS)} FROM ledger ORDER BY rowid"
_PUT = f"""
    INSERT INTO ledger ({", ".join(_COLUMNS)}) VALUES ({", ".join("?" * len(_COLUMNS))})
    ON CONFLICT (client, id) DO UPDATE SET
    {", ".join(f"{name} = excluded.{name}" for name in _COLUMNS if name not in _KEPT)},
    may_be_written = max(may_be_written, excluded.may_be_written)
"""
_SELECT_UNTOLD = "SELECT client, id FROM untold"
_PUT_UNTOLD = "INSERT OR IGNORE INTO untold (client, id) VALUES (?, ?)"
_FORGET_UNTOLD = "DELETE FROM untold WHERE client = ? AND id = ?"
_FORGET_UNKNOWN = """
    DELETE FROM untold WHERE NOT EXISTS
    (SELECT 1 FROM ledger WHERE ledger.client = untold.client AND ledger.id = untold.id)
"""
_FORGET_OLD = """
    DELETE FROM ledger WHERE is_final AND since_s < ? AND rowid <= (SELECT max(rowid) FROM ledger) - ?
"""
_FORGET_OLDEST = """
    DELETE FROM ledger WHERE rowid IN (SELECT rowid FROM ledger WHERE is_final ORDER BY rowid LIMIT ?)
"""
_COUNT = "SELECT count(*) FROM ledger"


class LedgerTable:
    """The table; rows of commands under way are never forgotten, of the others the oldest first."""

    def __init__(
        self, *, most_rows: int = MOST_ROWS, longest_s: float = LONGEST_S, least_rows: int = LEAST_ROWS
    ) -> None:
        self._most_rows = most_rows
        self._longest_s = longest_s
        self._least_rows = least_rows
        self._until_pruned = 0

    def create(self, connection: Connection) -> None:
        """Create the table when it is missing."""
        connection.execute(_CREATE)
        connection.execute(_CREATE_UNTOLD)
        connection.execute(f"{_SELECT} LIMIT 1")
        connection.execute(f"{_SELECT_UNTOLD} LIMIT 1")

    def make_room(self, connection: Connection) -> None:
        """Delete the oldest tenth."""
        (count,) = connection.execute(_COUNT).fetchone()
        connection.execute(_FORGET_OLDEST, (count // 10 + 1,))
        connection.execute(_FORGET_UNKNOWN)

    def put(self, connection: Connection, *, row: LedgerRow, now_s: float, is_untold: bool = False) -> None:
        """Keep a row as its command's latest; `is_untold` until `tell` says otherwise; `now_s` is UTC."""
        connection.execute(_PUT, astuple(row))
        if is_untold:
            connection.execute(_PUT_UNTOLD, (row.client, row.id))
        self._until_pruned -= 1
        if self._until_pruned < 0:
            self._until_pruned = PRUNED_EVERY
            self._prune(connection, now_s)

    def tell(self, connection: Connection, *, client: str, id_: str) -> None:
        """Note that a command's final result has reached the broker."""
        connection.execute(_FORGET_UNTOLD, (client, id_))

    def untold(self, connection: Connection) -> frozenset[tuple[str, str]]:
        """Return the client and id of each command whose final result may not have reached the broker."""
        return frozenset((str(client), str(id_)) for client, id_ in connection.execute(_SELECT_UNTOLD))

    def rows(self, connection: Connection) -> list[LedgerRow]:
        """Return all rows, the oldest first; DamagedError when one makes no sense."""
        rows = []
        for values in connection.execute(_SELECT):
            if not all(isinstance(value, kind) for value, kind in zip(values, _TYPES, strict=True)):
                raise DamagedError("a row of the ledger has lost its shape")
            rows.append(LedgerRow(*values))
        return rows

    def _prune(self, connection: Connection, now_s: float) -> None:
        connection.execute(_FORGET_OLD, (now_s - self._longest_s, self._least_rows))
        (count,) = connection.execute(_COUNT).fetchone()
        if count > self._most_rows:
            connection.execute(_FORGET_OLDEST, (count - self._most_rows,))
        connection.execute(_FORGET_UNKNOWN)
