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
from gateway.store.outbox import (
    DAMAGED,
    DISK_FULL,
    Deleted,
    Loss,
    OutboxRow,
    OutboxTable,
    Page,
    Rank,
    Total,
    losses_of,
    merged,
)
from gateway.store.schema import OUTBOX, STATE, STATE_FILE
from gateway.store.worker import RETRY_S, News, OnNews, Store

__all__ = [
    "DAMAGED",
    "DISK_FULL",
    "OUTBOX",
    "RETRY_S",
    "STATE",
    "STATE_FILE",
    "Connection",
    "Deleted",
    "FullError",
    "Loss",
    "News",
    "OnNews",
    "OutboxRow",
    "OutboxTable",
    "Page",
    "Rank",
    "Schema",
    "Store",
    "Total",
    "Work",
    "losses_of",
    "merged",
    "newer_text",
    "read_file",
    "snapshot",
    "stored_version",
]
