"""The tables of a gateway's two files, and the steps from each version of them to the next.

`state.sqlite` has the commands, what waits for the broker, documents and the audit: one transaction may touch
them all. A step never changes once it was released: a changed table is one step more.
"""

from __future__ import annotations

from gateway.store.database import Schema, Work
from gateway.store.outbox import ID_BITS

STATE_FILE, HISTORY_FILE = "state.sqlite", "history.sqlite"

_STATE = (
    """
    CREATE TABLE commands (
        client TEXT NOT NULL, id TEXT NOT NULL, starter TEXT NOT NULL, may_be_written INTEGER NOT NULL,
        result TEXT NOT NULL, PRIMARY KEY (client, id)
    )
    """,
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
    "CREATE TABLE documents (name TEXT PRIMARY KEY, body TEXT NOT NULL) WITHOUT ROWID",
    "CREATE TABLE audit (number INTEGER PRIMARY KEY, line TEXT NOT NULL, upto INTEGER NOT NULL)",
)
_HISTORY = """
    CREATE TABLE history (
        number INTEGER PRIMARY KEY AUTOINCREMENT, starter TEXT NOT NULL, kind TEXT NOT NULL, id TEXT NOT NULL,
        time_s REAL NOT NULL, data BLOB NOT NULL, UNIQUE (starter, kind, id)
    )
"""


def _step(*statements: str) -> Work:
    return lambda connection: [connection.execute(sql) for sql in statements]


STATE = Schema("state", steps=(_step(*_STATE),))
HISTORY = Schema("history", steps=(_step(_HISTORY),))
SCHEMAS = {HISTORY_FILE: HISTORY, STATE_FILE: STATE}  # an import is done once the last is there
