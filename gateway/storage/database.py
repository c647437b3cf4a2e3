"""One SQLite file that may be damaged, foreign, full or away; the only module that knows sqlite3."""

from __future__ import annotations

import logging
import os
import sqlite3
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Protocol, TypeVar

from gateway.errors import DamagedError, NewerError, StoreError
from gateway.store import HISTORY, newer_text

log = logging.getLogger(__name__)

Connection = sqlite3.Connection
T = TypeVar("T")

FORMAT = len(HISTORY.steps)
APPLICATION_ID = 0x53474154  # "SGAT": a file without it is not ours
PAGE_BYTES = 4096
CACHE_KIB = 512  # rows are written once and read once: more would only fill up memory
LOCKED_WITHIN_S = 1.0  # how long another process may take to release the file
MOST_ASIDE = 3  # files set aside; older ones are deleted, so that they do not fill the disk

_DAMAGE = frozenset({sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_FORMAT})
_COMPANIONS = ("", "-wal", "-shm", "-journal")  # what SQLite keeps beside a file (sqlite.org/tempfiles.html)
_ASIDE = ".aside-"
_STAMP_DIGITS = 20
_RESTORED = "restored_s"
_CREATE_META = "CREATE TABLE IF NOT EXISTS meta (key TEXT PRIMARY KEY, value REAL)"
_FORGET_RESTORED = f"DELETE FROM meta WHERE key = '{_RESTORED}'"


class FullError(StoreError):
    """The file has reached its bound, or the disk its end."""


class SqlTable(Protocol):
    """One caller's tables; called within a transaction."""

    def create(self, connection: Connection) -> None:
        """Create what is missing, and select every column once, so that another shape shows."""
        ...

    def make_room(self, connection: Connection) -> None:
        """Delete the oldest tenth or so: the file is full."""
        ...


class Database:
    """The file, open or not; all calls belong to one thread."""

    def __init__(
        self, path: Path, tables: Sequence[SqlTable], max_bytes: int, *, cache_kib: int = CACHE_KIB
    ) -> None:
        self.path = path
        self._cache_kib = cache_kib
        self.lost_s: float | None = None
        self._tables = tables
        self._max_pages = max(max_bytes // PAGE_BYTES, 1)
        self._connection: Connection | None = None
        self._is_flushing = True
        self._place: tuple[int, int] | None = None

    @property
    def is_open(self) -> bool:
        """Return whether work can be done."""
        return self._connection is not None

    @property
    def is_in_place(self) -> bool:
        """Return whether the open file is still the one of this name; SQLite itself would not notice."""
        return self._place == _place(self.path)

    def open(self, *, is_lost: bool = False) -> str:
        """Open or create the file; return what had to be put aside for it, if anything."""
        with _translated(self.path):
            self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        try:
            self._connection = self._connect(is_lost=is_lost)
        except DamagedError as error:
            return self.replace(error)
        return ""

    def replace(self, error: DamagedError) -> str:
        """Put the file aside and open a new one; return what people should know of it."""
        self.close()
        with _translated(self.path):
            aside = _put_aside(self.path)
        self._connection = self._connect(is_lost=True)
        return f"{error}; put aside as {aside.name}, a new one is used"

    def transact(self, works: Sequence[Callable[[Connection], Any]], *, is_flushed: bool = True) -> list[Any]:
        """Do the work in one transaction, and return its answers when it is on the disk.

        What is not flushed is in the kernel's hands: it outlives the process, but not a power cut, until the
        next transaction that is.
        """
        if self._connection is None:
            raise StoreError(f"{self.path} is not open")
        if not works:
            return []
        with _translated(self.path):
            if is_flushed != self._is_flushing:
                _ask(self._connection, f"PRAGMA synchronous = {'FULL' if is_flushed else 'NORMAL'}")
                self._is_flushing = is_flushed
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                answers = [work(self._connection) for work in works]
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise
        return answers

    def make_room(self) -> None:
        """Let every table delete its oldest rows."""
        self.transact([table.make_room for table in self._tables])

    def close(self) -> None:
        """Close the file."""
        connection, self._connection = self._connection, None
        if connection is not None:
            try:
                connection.close()
            except sqlite3.Error as error:  # its last checkpoint failed: the next one to open it does that
                log.info("store=%s %s", self.path, error)

    def _connect(self, *, is_lost: bool) -> Connection:
        with _translated(self.path):
            is_there = self.path.exists()
            if is_there and not self.path.is_file():
                raise DamagedError(f"{self.path} is no file")
            connection = sqlite3.connect(self.path, timeout=LOCKED_WITHIN_S, isolation_level=None)
            try:
                self._prepare(connection, is_lost=is_lost, is_there=is_there)
            except BaseException as error:
                connection.close()
                if _code(error) == sqlite3.SQLITE_ERROR:  # our own SQL does not fit to what is there
                    raise DamagedError(f"{self.path}: {error}") from error
                raise
            self._place = _place(self.path)
        return connection

    def _prepare(self, connection: Connection, *, is_lost: bool, is_there: bool) -> None:
        """Make sure that the file is ours, whole and writable; an empty one has lost what was in it."""
        connection.text_factory = lambda octets: octets.decode("utf-8", "replace")
        if _ask(connection, "SELECT count(*) FROM sqlite_master"):
            _require_ours(connection, self.path)
            if _ask(connection, "PRAGMA quick_check(1)") != "ok":
                raise DamagedError(f"{self.path} is damaged")
        else:
            is_lost = is_lost or is_there
            _ask(connection, f"PRAGMA page_size = {PAGE_BYTES}")
        if _ask(connection, "PRAGMA journal_mode = WAL") != "wal":
            raise StoreError(f"{self.path}: no write-ahead log is possible here")
        _ask(connection, "PRAGMA synchronous = FULL")
        self._is_flushing = True
        _ask(connection, f"PRAGMA max_page_count = {self._max_pages}")
        _ask(connection, f"PRAGMA cache_size = -{self._cache_kib}")
        _ask(connection, f"PRAGMA journal_size_limit = {2**20}")
        connection.execute("BEGIN IMMEDIATE")
        connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        connection.execute(f"PRAGMA user_version = {FORMAT}")
        connection.execute(_CREATE_META)
        is_lost = connection.execute(_FORGET_RESTORED).rowcount > 0 or is_lost
        keys = ("opened_s", "lost_s") if is_lost else ("opened_s",)
        connection.executemany("REPLACE INTO meta VALUES (?, ?)", [(key, time.time()) for key in keys])
        for table in self._tables:
            table.create(connection)
        connection.execute("COMMIT")
        lost_s = _ask(connection, "SELECT value FROM meta WHERE key = 'lost_s'")
        self.lost_s = lost_s if isinstance(lost_s, float) else None


def read_file(path: Path, work: Callable[[Connection], T]) -> T:
    """Do some work on a shared file of another process, or of none, without changing it; StoreError."""
    with _translated(path):
        os.stat(path)
        with closing(_reader(path)) as connection:
            _require_ours(connection, path)
            connection.execute("BEGIN")  # one moment's state, whatever is written meanwhile
            return work(connection)


def _reader(path: Path) -> Connection:
    """Open a file for reading; also one whose folder cannot be written, where SQLite could make no log.

    Without a log no process has it open, so what is read cannot change meanwhile (sqlite.org/wal.html 5).
    """
    is_fixed = not os.path.lexists(f"{path}-wal") and not os.access(path.parent, os.W_OK)
    uri = f"{path.absolute().as_uri()}?mode=ro{'&immutable=1' if is_fixed else ''}"
    return sqlite3.connect(uri, uri=True, timeout=LOCKED_WITHIN_S, isolation_level=None)


def _marks(connection: Connection) -> tuple[int, int]:
    return _ask(connection, "PRAGMA application_id"), _ask(connection, "PRAGMA user_version")


def _require_ours(connection: Connection, path: Path) -> None:
    """Raise DamagedError for another program's file, NewerError for one of a later version."""
    application, version = _marks(connection)
    if application != APPLICATION_ID or version < FORMAT:
        raise DamagedError(f"{path} is another program's")
    if version > FORMAT:
        raise NewerError(newer_text(path, version, HISTORY))


@contextmanager
def _translated(path: Path) -> Iterator[None]:
    """Raise StoreError for an error of SQLite or the file system; an error in our SQL is raised as it is."""
    try:
        yield
    except OSError as error:
        raise StoreError(f"{error.filename or path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:  # of a message that quotes what is damaged
        raise DamagedError(f"{path}: a text in it is no UTF-8") from error
    except sqlite3.Error as error:
        code = _code(error)
        if code in _DAMAGE:
            raise DamagedError(f"{path}: {error}") from error
        if code == sqlite3.SQLITE_FULL:
            raise FullError(f"{path}: {error}") from error
        if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
            raise StoreError(f"{path} is in use by another process") from error
        if code in (None, sqlite3.SQLITE_ERROR):
            raise
        raise StoreError(f"{path}: {error}") from error


def _code(error: BaseException) -> int | None:
    """Return the primary result code of an SQLite error (sqlite.org/rescode.html)."""
    code = getattr(error, "sqlite_errorcode", None)
    return None if code is None else code & 0xFF


def _ask(connection: Connection, sql: str) -> Any:
    row = connection.execute(sql).fetchone()
    return None if row is None else row[0]


def _place(path: Path) -> tuple[int, int] | None:
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _put_aside(path: Path) -> Path:
    """Rename a file and SQLite's files beside it, and return its new name; delete the oldest such files."""
    stem = f"{path.name}{_ASIDE}{time.time_ns():0{_STAMP_DIGITS}d}"
    for end in _COMPANIONS:
        if os.path.lexists(f"{path}{end}"):
            os.rename(f"{path}{end}", path.with_name(stem + end))
    _forget_oldest(path)
    return path.with_name(stem)


def _forget_oldest(path: Path) -> None:
    length = len(path.name) + len(_ASIDE) + _STAMP_DIGITS
    entries = sorted(entry for entry in path.parent.iterdir() if entry.name.startswith(path.name + _ASIDE))
    recent = sorted({entry.name[:length] for entry in entries})[-MOST_ASIDE:]
    for entry in entries:
        if entry.name[:length] not in recent and not entry.is_dir():
            entry.unlink()
