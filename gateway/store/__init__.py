"""What outlives a run: two SQLite files, each with one thread that writes it.

`schema` says what is in them, `worker` writes, `database` alone knows SQLite. From outside everything is
imported from here.
"""

from gateway.store.database import (
    Connection,
    FullError,
    Schema,
    Work,
    newer_text,
    read_file,
    snapshot,
    stored_version,
)
from gateway.store.schema import STATE, STATE_FILE
from gateway.store.worker import RETRY_S, News, OnNews, Store

__all__ = [
    "RETRY_S",
    "STATE",
    "STATE_FILE",
    "Connection",
    "FullError",
    "News",
    "OnNews",
    "Schema",
    "Store",
    "Work",
    "newer_text",
    "read_file",
    "snapshot",
    "stored_version",
]
