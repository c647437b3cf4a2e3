"""The state that outlives a run: two SQLite files, each with one thread that writes it.

`schema` has their tables, `worker` the thread and the work that waits for it, `database` alone knows SQLite.
From outside everything is imported from here.
"""

from gateway.store import backup
from gateway.store.audit import append_note, read_audit
from gateway.store.chain import FIRST_HASH, Head, Verification, verify
from gateway.store.commands import INTEND_WITHIN_S, Journal, Remembered
from gateway.store.database import Connection, Work
from gateway.store.documents import Document, Documents, read_document, write_document
from gateway.store.history import CURVES, HistoryRow, HistoryStore, read_history, with_curves
from gateway.store.import_0_2 import is_import_due
from gateway.store.outbox import (
    Loss,
    OutboxPage,
    OutboxRow,
    OutboxTable,
    Rank,
    Total,
    merged,
)
from gateway.store.schema import HISTORY_FILE, STATE_FILE
from gateway.store.state import StateStore
from gateway.store.worker import BEHIND_S, RETRY_S, News, Store
