"""What outlives a run: two SQLite files, each with one thread that writes it.

`schema` says what is in them, `worker` writes, `database` alone knows SQLite. From outside everything is
imported from here.
"""

from gateway.store.audit import Anchor, append_note, read_audit
from gateway.store.backup import (
    LOCK_FILE,
    Archive,
    Manifest,
    Member,
    copy_state,
    is_state_name,
    is_upgrade_due,
    keep_private,
    open_archive,
    own_files,
    refuse_newer,
    upgrade,
    write_archive,
)
from gateway.store.chain import FIRST_HASH, Verification, verify
from gateway.store.commands import INTEND_WITHIN_S, CommandTable, Journal, NoJournal, Remembered
from gateway.store.database import (
    Connection,
    FullError,
    Schema,
    Work,
    mark_restored,
    read_file,
    write_file,
)
from gateway.store.documents import Document, Documents, read_document, write_document
from gateway.store.history import HistoryRow, HistoryStore, read_history
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
from gateway.store.schema import HISTORY, HISTORY_FILE, SCHEMAS, STATE, STATE_FILE
from gateway.store.state import StateStore
from gateway.store.worker import RETRY_S, News, OnNews, Store
