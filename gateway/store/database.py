"""One SQLite file that may be damaged, foreign, full or away; the only module that knows sqlite3.

Invariants: a file is ours by its application id, and of this program by its version; its tables have exactly
the shape that the schema's steps make; whatever else stands in its place is renamed, never overwritten.
Without a path the same lives in memory.
"""

from __future__ import annotations

import errno
import logging
import os
import sqlite3
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from gateway.errors import DamagedError, NewerError, StoreError
from gateway.system.whole_files import NEW, private, put_in_place, sync_file

log = logging.getLogger(__name__)

Connection = sqlite3.Connection
Work = Callable[[Connection], Any]
RESERVE_BYTES = 2**20
T = TypeVar("T")

PAGE_BYTES = 1024  # a transaction of a row or two writes some four pages, and again to write them back
CACHE_KIB = 512  # rows are written once and read once: more would only fill up memory
LOG_BYTES = 2**20  # of the write-ahead log once it has been written back
LOGGED_PAGES = 100  # then it is: the file grows by these, and the reserve must be enough for that
LOCKED_WITHIN_S = 1.0  # how long another process may take to release the file
WRITTEN_BYTES = 2**30  # bound of a file that is written once
LAST_VERSION = 999  # a file that says a higher one is damaged
SHRUNK_PAGES = 400  # given back to a full disk at a time: they pass through the write-ahead log

_DAMAGE = frozenset({sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_FORMAT})
_COMPANIONS = ("", "-wal", "-shm", "-journal")  # what SQLite keeps beside a file (sqlite.org/tempfiles.html)
_ASIDE = ".aside"  # ends the name of the file that was set aside last: more would fill the disk
_SHAPE = "SELECT sql FROM sqlite_master WHERE name NOT LIKE 'sqlite_stat%' ORDER BY name"


class FullError(StoreError):
    """The file has reached its bound, or the disk its end."""


class Schema(NamedTuple):
    """What is in a file. The version of a file is the number of steps that it has been taken through."""

    name: str  # of its thread and in logs
    application_id: int  # a file without it is not ours
    steps: tuple[Work, ...]  # each makes one version of the one before

    def shape(self) -> list[Any]:
        """Return the SQL of everything that is in a file of the newest version."""
        with closing(sqlite3.connect(":memory:")) as connection:
            for step in self.steps:
                step(connection)
            return connection.execute(_SHAPE).fetchall()


class Database:
    """The file, open or not; all calls belong to one thread."""

    def __init__(self, path: Path | None, schema: Schema, *, max_bytes: int) -> None:
        self.path = path or Path(":memory:")
        self._is_file = path is not None
        self._schema = schema
        self._max_pages = max(max_bytes // PAGE_BYTES, 1)
        self.on_lost: Callable[[str], object] = lambda _: None  # gets what people should know of it
        self._reserve = Reserve(path)
        self._connection: Connection | None = None

    @property
    def is_open(self) -> bool:
        """Return whether work can be done."""
        return self._connection is not None

    def open(self) -> None:
        """Open or create the file; one that is damaged is put aside. StoreError."""
        if self._is_file:
            with translated(self.path):
                self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        try:
            self._connect()
        except DamagedError as error:
            self.replace(error)
        except FullError:
            if not self._reserve.give_up():
                raise
            self._connect()

    def replace(self, error: DamagedError) -> None:
        """Put the file aside and open a new one. StoreError."""
        self.close()
        with translated(self.path):
            aside = put_aside(self.path) if self._is_file else self.path
        self.on_lost(f"{error}; put aside as {aside.name}, a new one begins")
        self._connect()

    def transact(self, works: Iterable[Work], *, is_flushed: bool = True) -> list[Any]:
        """Do the work in one transaction, and return its answers when it is on the disk.

        What is not flushed is in the kernel's hands: it outlives the process, but not a power cut, until the
        next transaction that is.
        """
        connection = self._opened()
        with translated(self.path):
            _ask(connection, f"PRAGMA synchronous = {'FULL' if is_flushed else 'NORMAL'}")
            connection.execute("BEGIN IMMEDIATE")
            try:
                answers = [work(connection) for work in works]
                connection.execute("COMMIT")
            except BaseException:
                if connection.in_transaction:
                    connection.execute("ROLLBACK")
                raise
        return answers

    def take_reserve(self) -> None:
        """Take the room again that was given up, as soon as the disk has it; FullError.

        The log of a transaction that failed for want of room is as long as that, and may take up that room.
        """
        self._shrink()
        with translated(self.path):
            if not self._reserve.take():
                raise FullError(f"{self.path}: the disk is full")

    def relieve(self, works: Iterable[Work]) -> list[Any]:
        """Do work that deletes, by means of the reserve: the disk is full, and deleting needs room too.

        The log is written back first: while the disk was full it could not be, and it has to be begun again.
        """
        if self._reserve.give_up():
            self._shrink()
        answers = self.transact(works)
        self._shrink()
        return answers

    def _shrink(self) -> None:
        """Give back to a full disk what the file does not need, as far as that is possible now."""
        connection = self._opened()
        try:
            with translated(self.path):
                # As a script: it makes a step a page, of which `execute` takes the first alone.
                connection.executescript(f"PRAGMA incremental_vacuum({SHRUNK_PAGES})")
                _ask(connection, "PRAGMA wal_checkpoint(TRUNCATE)")
        except StoreError as error:  # the next attempt does it
            log.debug("store=%s %s", self.path, error)

    def close(self) -> None:
        """Close the file."""
        connection, self._connection = self._connection, None
        if connection is not None:
            try:
                connection.close()
            except sqlite3.Error as error:  # its last checkpoint failed: the next one to open it does that
                log.info("store=%s %s", self.path, error)

    def _opened(self) -> Connection:
        if self._connection is None:
            raise StoreError(f"{self.path} is not open")
        return self._connection

    def _connect(self) -> None:
        with translated(self.path):
            is_there = self._is_file and self.path.exists()
            if is_there and not self.path.is_file():
                raise DamagedError(f"{self.path} is no file")
            if self._is_file and not is_there:
                os.close(private(str(self.path), os.O_RDWR | os.O_CREAT))
            connection = sqlite3.connect(self.path, timeout=LOCKED_WITHIN_S, isolation_level=None)
            try:
                self._prepare(connection)
            except BaseException as error:
                connection.close()
                # Our own SQL does not fit to what is there, or its header forbids to write it.
                is_locked = _code(error) == sqlite3.SQLITE_READONLY and os.access(self.path, os.W_OK)
                if _code(error) == sqlite3.SQLITE_ERROR or is_locked:
                    raise DamagedError(f"{self.path}: {error}") from error
                raise
        self._connection = connection

    def _prepare(self, connection: Connection) -> None:
        """Make sure that the file is ours, whole, writable, and of this version."""
        connection.text_factory = _text
        version = 0
        if _ask(connection, "SELECT count(*) FROM sqlite_master"):
            version = _known_version(connection, self.path, self._schema)
            if _ask(connection, "PRAGMA quick_check(1)") != "ok":
                raise DamagedError(f"{self.path} is damaged")
        else:
            _ask(connection, f"PRAGMA page_size = {PAGE_BYTES}")
            _ask(connection, "PRAGMA auto_vacuum = INCREMENTAL")  # so that a full disk gets room back
        if _ask(connection, "PRAGMA journal_mode = WAL") != "wal" and self._is_file:
            raise StoreError(f"{self.path}: no write-ahead log is possible here")
        for setting in (
            "synchronous = FULL",
            f"max_page_count = {self._max_pages}",
            f"cache_size = -{CACHE_KIB}",
            f"journal_size_limit = {LOG_BYTES}",
            f"wal_autocheckpoint = {LOGGED_PAGES}",
        ):
            _ask(connection, f"PRAGMA {setting}")
        connection.execute("BEGIN IMMEDIATE")
        for step in self._schema.steps[version:]:
            step(connection)
        connection.execute(f"PRAGMA application_id = {self._schema.application_id}")
        connection.execute(f"PRAGMA user_version = {len(self._schema.steps)}")
        connection.execute("COMMIT")
        if connection.execute(_SHAPE).fetchall() != self._schema.shape():
            raise DamagedError(f"{self.path} has other tables")


def snapshot(path: Path, copy: Path, schema: Schema) -> int:
    """Copy a database as it is at one moment, also while a gateway writes to it; return its version.

    The copy appears whole and on the disk, for its owner alone, or not at all. DamagedError, NewerError,
    StoreError.
    """
    if path.exists() and not os.access(path, os.R_OK):
        raise StoreError(f"{path} may not be read by this user (make the backup as root)")
    new = copy.with_name(copy.name + NEW)
    with translated(copy):
        new.unlink(missing_ok=True)
        os.close(private(str(new), os.O_RDWR | os.O_CREAT))
        with translated(path), closing(_reader(path)) as source:
            version = _known_version(source, path, schema)
            source.execute("VACUUM INTO ?", (str(new),))
        sync_file(new)
        put_in_place(new, copy)
    return version


def stored_version(path: Path, schema: Schema) -> int | None:
    """Return the version of a database as it is; None when there is none, or none that can be read."""
    with suppress(OSError, StoreError, sqlite3.Error):
        if path.is_file():
            with translated(path), closing(_reader(path, is_idle=True)) as connection:
                return _version(connection, path, schema)
    return None


def read_file(path: Path, schema: Schema, work: Callable[[Connection], T], *, is_idle: bool = False) -> T:
    """Do some work on a shared file of another process, or of none, without changing it; StoreError.

    `is_idle`: no process opens it meanwhile, unless one has already.
    """
    with translated(path):
        os.stat(path)
        with closing(_reader(path, is_idle=is_idle)) as connection:
            _known_version(connection, path, schema)
            connection.execute("BEGIN")  # one moment's state, whatever is written meanwhile
            try:
                return work(connection)
            except sqlite3.OperationalError as error:
                if _code(error) != sqlite3.SQLITE_ERROR:
                    raise
                raise DamagedError(f"{path} is of an earlier version, or damaged: {error}") from error


def write_file(path: Path, schema: Schema, work: Work) -> None:
    """Do some work on a file that no process has open, and that is made where there is none; StoreError."""
    database = Database(path, schema, max_bytes=WRITTEN_BYTES)
    try:
        database.open()
        database.transact([work])
    finally:
        database.close()


def _reader(path: Path, *, is_idle: bool = False) -> Connection:
    """Open a file for reading; also one whose folder cannot be written, where SQLite could make no log.

    Nothing is made beside one that is idle. Without a log no process has it open, so what is read cannot
    change meanwhile (sqlite.org/wal.html 5).
    """
    is_fixed = not os.path.lexists(f"{path}-wal") and (is_idle or not os.access(path.parent, os.W_OK))
    uri = f"{path.absolute().as_uri()}?mode=ro{'&immutable=1' if is_fixed else ''}"
    connection = sqlite3.connect(uri, uri=True, timeout=LOCKED_WITHIN_S, isolation_level=None)
    connection.text_factory = _text
    return connection


def _text(octets: bytes) -> str:
    """Return a text, also of a file that is damaged."""
    return octets.decode("utf-8", "replace")


def _version(connection: Connection, path: Path, schema: Schema) -> int:
    """Return a file's version, also a later one; DamagedError for another program's file."""
    application, version = (_ask(connection, f"PRAGMA {each}") for each in ("application_id", "user_version"))
    if application != schema.application_id or not 1 <= version <= LAST_VERSION:
        raise DamagedError(f"{path} is another program's")
    return int(version)


def _known_version(connection: Connection, path: Path, schema: Schema) -> int:
    """Return a file's version; DamagedError for another program's, NewerError for one of a later version."""
    version = _version(connection, path, schema)
    refuse_later(version, path, schema)
    return version


def refuse_later(version: int, path: Path, schema: Schema) -> None:
    """Raise NewerError for a file that a later version of this program has written."""
    if version > len(schema.steps):
        raise NewerError(
            f"{path} has format {version}, and this program knows formats up to {len(schema.steps)} "
            "(install the version that wrote it, or restore an earlier backup: docs/upgrade.md)"
        )


@contextmanager
def translated(path: Path) -> Iterator[None]:
    """Raise StoreError for an error of SQLite or the file system; an error in our SQL is raised as it is."""
    try:
        yield
    except OSError as error:
        kind = FullError if error.errno in (errno.ENOSPC, errno.EDQUOT) else StoreError
        raise kind(f"{error.filename or path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:  # of a message that quotes what is damaged
        raise DamagedError(f"{path}: a text in it is no UTF-8") from error
    except sqlite3.Error as error:
        code = _code(error)
        if code in _DAMAGE:
            raise DamagedError(f"{path}: {error}") from error
        if code == sqlite3.SQLITE_FULL or _is_index_full(error):
            raise FullError(f"{path}: {error}") from error
        if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
            raise StoreError(f"{path} is in use by another process") from error
        if code in (None, sqlite3.SQLITE_ERROR, sqlite3.SQLITE_CONSTRAINT):
            raise
        raise StoreError(f"{path}: {error}") from error


def _code(error: BaseException) -> int | None:
    """Return the primary result code of an SQLite error (sqlite.org/rescode.html)."""
    code = getattr(error, "sqlite_errorcode", None)
    return None if code is None else code & 0xFF


def _is_index_full(error: sqlite3.Error) -> bool:
    """Return whether the log's index could not grow: SQLite has an error of its own for that."""
    return getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_IOERR_SHMSIZE


def _ask(connection: Connection, sql: str) -> Any:
    row = connection.execute(sql).fetchone()
    return None if row is None else row[0]


def put_aside(path: Path) -> Path:
    """Rename a file and SQLite's files beside it, and return its new name; an earlier such file goes."""
    aside = path.with_name(f"{path.name}{_ASIDE}")
    for end in _COMPANIONS:
        Path(f"{aside}{end}").unlink(missing_ok=True)
        if os.path.lexists(f"{path}{end}"):
            os.rename(f"{path}{end}", f"{aside}{end}")
    return aside


class Reserve:
    """Room on the disk that is given up while the disk is full: deleting rows needs room too.

    It is a file beside the database, allocated and never written; of a database in memory there is none.
    There is enough room only when the disk has as much left besides, so that a store on a full disk does not
    change its mind every few seconds.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = None if path is None else path.with_name(f"{path.name}-reserve")

    @property
    def is_held(self) -> bool:
        """Return whether the room is taken, by this run or an earlier one."""
        try:
            return self._path is None or self._path.stat().st_size == RESERVE_BYTES
        except OSError:
            return False

    def take(self) -> bool:
        """Take the room, and return whether there is enough; OSError."""
        if self._path is None:
            return True
        disk, is_held = os.statvfs(self._path.parent), self.is_held
        if disk.f_bavail * disk.f_frsize < (1 if is_held else 2) * RESERVE_BYTES:
            return False
        if not is_held:
            with open(self._path, "wb", opener=private) as file:
                os.posix_fallocate(file.fileno(), 0, RESERVE_BYTES)
        return True

    def give_up(self) -> bool:
        """Give the room back to the disk; return whether there was any."""
        is_held = self._path is not None and self.is_held
        if self._path is not None and is_held:
            os.truncate(self._path, 0)
        return is_held
