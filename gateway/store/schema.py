"""What is in a gateway's two files, and how each version of them is made of the one before.

`state.sqlite` has the commands, what waits for the broker, documents and the audit: one transaction may touch
them all. A step never changes once it was released: a changed table is one step more.
"""

from __future__ import annotations

from gateway.store.database import Connection, Schema
from gateway.store.outbox import TABLES

STATE_FILE, HISTORY_FILE = "state.sqlite", "history.sqlite"

_COMMANDS = """
    CREATE TABLE commands (
        client TEXT NOT NULL, id TEXT NOT NULL, starter TEXT NOT NULL, may_be_written INTEGER NOT NULL,
        result TEXT NOT NULL, PRIMARY KEY (client, id)
    )
"""
_DOCUMENTS = "CREATE TABLE documents (name TEXT PRIMARY KEY, body TEXT NOT NULL) WITHOUT ROWID"
_HISTORY = """
    CREATE TABLE history (
        number INTEGER PRIMARY KEY AUTOINCREMENT, starter TEXT NOT NULL, kind TEXT NOT NULL, id TEXT NOT NULL,
        time_s REAL NOT NULL, data BLOB NOT NULL, UNIQUE (starter, kind, id)
    )
"""
_AUDIT = "CREATE TABLE audit (number INTEGER PRIMARY KEY, line TEXT NOT NULL, upto INTEGER NOT NULL)"


def _first(connection: Connection) -> None:
    for sql in (_COMMANDS, *TABLES, _DOCUMENTS, _AUDIT):
        connection.execute(sql)


STATE = Schema("state", application_id=0x53475354, steps=(_first,))  # "SGST"
HISTORY = Schema("history", application_id=0x53474849, steps=(lambda each: each.execute(_HISTORY),))  # "SGHI"
SCHEMAS = {STATE_FILE: STATE, HISTORY_FILE: HISTORY}
