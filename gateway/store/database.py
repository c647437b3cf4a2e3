"""One SQLite file that may be damaged, full or away; the only module that knows sqlite3.

Invariants: the file has exactly the tables that the schema's steps make; a damaged file is renamed, never
overwritten. Without a path the same lives in memory.
"""

from __future__ import annotations

import errno
import os
import sqlite3
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from gateway.errors import DamagedError, NewerError, StoreError
from gateway.system.whole_files import private

Connection = sqlite3.Connection
Work = Callable[[Connection], Any]
T = TypeVar("T")

RESERVE_BYTES = 2**20
PAGE_BYTES = 1024  # a transaction of a row or two writes some four pages, and again to write them back
CACHE_KIB = 512  # rows are written once and read once: more would only fill up memory
LOG_BYTES = 2**20  # of the write-ahead log once it has been written back
LOGGED_PAGES = 100  # then it is: the file grows by these, and the reserve must be enough for that
LOCKED_WITHIN_S = 1.0  # how long another process may take to release the file
WRITTEN_BYTES = 2**30  # bound of a file that is written once
SHRUNK_PAGES = 400  # given back to a full disk at a time: they pass through the write-ahead log

_FULL = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_SHMSIZE)  # the file, or the log's index, cannot grow
_DAMAGE = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
_OWN_SQL = (None, sqlite3.SQLITE_ERROR, sqlite3.SQLITE_CONSTRAINT)  # the mistake is in a statement
_UNFIT = (sqlite3.SQLITE_ERROR, sqlite3.SQLITE_READONLY)  # other tables; a header that forbids to write
_COMPANIONS = ("", "-wal", "-shm", "-journal")  # what SQLite keeps beside a file (sqlite.org/tempfiles.html)
_ASIDE = ".aside"  # ends the name of the file that was set aside last: more would fill the disk
_TEXT = partial(str, encoding="utf-8", errors="replace")  # of a file that may be damaged
_SHAPE = "SELECT sql FROM sqlite_master WHERE name NOT LIKE 'sqlite_stat%' ORDER BY name"


class FullError(StoreError):
    """The file has reached its bound, or the disk its end."""


class Schema(NamedTuple):
    """The tables of a file. Its version is the number of steps that it has been taken through."""

    name: str  # of its thread and in logs
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
        self.on_lost: Callable[[str], object] = lambda _: None  # gets what people should know of it
        self._schema = schema
        self._max_pages = max(max_bytes // PAGE_BYTES, 1)
        # Room on the disk, allocated and never written, that is given up while the disk is full.
        self._reserve = None if path is None else path.with_name(f"{path.name}-reserve")
        self._connection: Connection | None = None
        self._damage: DamagedError | None = None  # found while the file was in use

    @property
    def is_open(self) -> bool:
        """Return whether work can be done."""
        return self._connection is not None

    def open(self) -> None:
        """Open or create the file; one that is damaged is put aside. StoreError."""
        try:
            if self._damage is not None:
                raise self._damage
            self._connect()
        except DamagedError as error:
            self.close()
            with translated(self.path):
                aside = put_aside(self.path)
            self._damage = None
            self.on_lost(f"{error}; put aside as {aside.name}, a new one begins")
            self._connect()
        except FullError:
            if not self._give_up_reserve():
                raise
            self._connect()

    def transact(self, works: Iterable[Work], *, is_flushed: bool = True) -> list[Any]:
        """Do the work in one transaction, and return its answers when it is on the disk.

        Work that is not flushed is in the kernel's hands: it outlives the process, but not a power cut, until
        the next transaction that is. A file that proves damaged is put aside when it is opened next: until
        then it keeps its name, so that no file of an earlier version takes its place.
        """
        connection = self._opened()
        try:
            with translated(self.path):
                _ask(connection, f"PRAGMA synchronous = {'FULL' if is_flushed else 'NORMAL'}")
                connection.execute("BEGIN IMMEDIATE")
                with connection:  # rolls back what fails
                    answers = [work(connection) for work in works]
                    connection.execute("COMMIT")  # fails where SQLite has rolled back
                    return answers
        except DamagedError as error:
            self._damage = error
            raise

    def take_reserve(self) -> None:
        """Take the room again that was given up, as soon as the disk has that much besides; FullError.

        The log of a transaction that failed for want of room is as long as that, and may take up that room.
        """
        self._shrink()
        if self._reserve is not None:
            with translated(self.path):
                held = self._reserve.stat().st_size if self._reserve.exists() else 0
                disk = os.statvfs(self.path.parent)
                if disk.f_bavail * disk.f_frsize < 2 * RESERVE_BYTES - held:
                    raise FullError(f"{self.path}: the disk is full")
                if held < RESERVE_BYTES:
                    with open(self._reserve, "wb", opener=private) as file:
                        os.posix_fallocate(file.fileno(), 0, RESERVE_BYTES)

    def relieve(self, works: Iterable[Work]) -> list[Any]:
        """Do work that deletes, by means of the reserve: the disk is full, and deleting needs room too.

        The log is written back first: while the disk was full it could not be, and it has to be begun again.
        """
        if self._give_up_reserve():
            self._shrink()
        answers = self.transact(works)
        self._shrink()
        return answers

    def close(self) -> None:
        """Close the file."""
        connection, self._connection = self._connection, None
        if connection is not None:
            with suppress(sqlite3.Error):  # its last checkpoint failed: the next one to open it does that
                connection.close()

    def _give_up_reserve(self) -> bool:
        """Give the room back to the disk; return whether there was any."""
        if self._reserve is None or not self._reserve.exists() or not self._reserve.stat().st_size:
            return False
        os.truncate(self._reserve, 0)
        return True

    def _shrink(self) -> None:
        """Give back to a full disk what the file does not need, as far as that is possible now."""
        connection = self._opened()
        with suppress(StoreError), translated(self.path):  # else the next attempt does it
            # As a script: it makes a step a page, of which `execute` takes the first alone.
            connection.executescript(f"PRAGMA incremental_vacuum({SHRUNK_PAGES})")
            _ask(connection, "PRAGMA wal_checkpoint(TRUNCATE)")

    def _opened(self) -> Connection:
        if self._connection is None:
            raise StoreError(f"{self.path} is not open")
        return self._connection

    def _connect(self) -> None:
        with translated(self.path):
            if self._reserve is not None:
                self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
                if not self.path.exists():  # to close one that is in use would drop SQLite's locks
                    os.close(private(str(self.path), os.O_RDWR | os.O_CREAT))
            connection = sqlite3.connect(self.path, timeout=LOCKED_WITHIN_S, isolation_level=None)
            try:
                self._prepare(connection)
            except BaseException as error:
                connection.close()
                if _code(error) in _UNFIT and os.access(self.path, os.W_OK):
                    raise DamagedError(f"{self.path}: {error}") from error
                raise
        self._connection = connection

    def _prepare(self, connection: Connection) -> None:
        """Make sure that the file is whole, writable, and of this version."""
        connection.text_factory = _TEXT
        if _ask(connection, "PRAGMA quick_check(1)") != "ok":
            raise DamagedError(f"{self.path} is damaged")
        version = _known_version(connection, self.path, self._schema)
        for setting in (
            f"page_size = {PAGE_BYTES}",  # of a new file
            "auto_vacuum = INCREMENTAL",  # so that a full disk gets room back
            "journal_mode = WAL",
            f"max_page_count = {self._max_pages}",
            f"cache_size = -{CACHE_KIB}",
            f"journal_size_limit = {LOG_BYTES}",
            f"wal_autocheckpoint = {LOGGED_PAGES}",
        ):
            _ask(connection, f"PRAGMA {setting}")
        connection.execute("BEGIN IMMEDIATE")
        with connection:
            for step in self._schema.steps[version:]:
                step(connection)
            connection.execute(f"PRAGMA user_version = {len(self._schema.steps)}")
        if connection.execute(_SHAPE).fetchall() != self._schema.shape():
            raise DamagedError(f"{self.path} has other tables")


def copy_file(path: Path, schema: Schema, copy: Path) -> int:
    """Copy a database as it is at one moment, while a gateway writes to it or not; return its version."""
    with _reader(path, schema) as (source, version):
        source.execute("VACUUM INTO ?", (str(copy),))
        return version


def stored_version(path: Path, schema: Schema) -> int:
    """Return the version of a database; NewerError for a later one, StoreError when it cannot be read."""
    with _reader(path, schema) as (_, version):
        return version


def read_file(path: Path, schema: Schema, work: Callable[[Connection], T]) -> T:
    """Do some work on a shared file of another process, or of none, without changing it; StoreError."""
    with _reader(path, schema) as (connection, _):
        connection.execute("BEGIN")  # one moment's state, whatever is written meanwhile
        return work(connection)


def write_file(path: Path, schema: Schema, work: Work) -> None:
    """Do some work on a file that no process has open, and that is made where there is none; StoreError."""
    database = Database(path, schema, max_bytes=WRITTEN_BYTES)
    try:
        database.open()
        database.transact([work])
    finally:
        database.close()


@contextmanager
def _reader(path: Path, schema: Schema) -> Iterator[tuple[Connection, int]]:
    """Open a file for reading; yield it with its version.

    Nothing is made beside one without a log: no process has it open. So nothing changes meanwhile
    (sqlite.org/wal.html 5), unless a gateway starts, which fails the reading.
    """
    with translated(path, are_bugs=False):
        if not path.exists():
            why = "No such file or directory (has a gateway run with this state_dir?)"
            raise StoreError(f"{path}: {why}")
        is_idle = not os.path.lexists(f"{path}-wal")
        uri = f"{path.absolute().as_uri()}?mode=ro{'&immutable=1' if is_idle else ''}"
        connection = sqlite3.connect(uri, uri=True, timeout=LOCKED_WITHIN_S, isolation_level=None)
        with closing(connection):
            connection.text_factory = _TEXT
            yield connection, _known_version(connection, path, schema)
        if is_idle and os.path.lexists(f"{path}-wal"):
            raise StoreError(f"{path} has just been opened by a gateway (try again)")


def _known_version(connection: Connection, path: Path, schema: Schema) -> int:
    """Return a file's version; NewerError for one that a later version of this program has written."""
    version = int(_ask(connection, "PRAGMA user_version"))
    if version > len(schema.steps):
        raise NewerError(
            f"{path} has format {version}, and this program knows formats up to {len(schema.steps)} "
            "(install the version that wrote it, or restore an earlier backup: docs/upgrade.md)"
        )
    return version


@contextmanager
def translated(path: Path, *, are_bugs: bool = True) -> Iterator[None]:
    """Raise StoreError for an error of SQLite or the file system.

    An error in our SQL is a bug, and raised as it is, unless the file may be of another version.
    """
    try:
        yield
    except OSError as error:
        kind: type[StoreError] = FullError if error.errno in (errno.ENOSPC, errno.EDQUOT) else StoreError
        raise kind(f"{error.filename or path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:  # of a message that quotes what is damaged
        raise DamagedError(f"{path}: a text in it is no UTF-8") from error
    except sqlite3.Error as error:
        code = _code(error)
        if are_bugs and code in _OWN_SQL:
            raise
        is_full = getattr(error, "sqlite_errorcode", None) in _FULL
        kind = DamagedError if code in _DAMAGE else FullError if is_full else StoreError
        raise kind(f"{path}: {error}") from error


def _code(error: BaseException) -> int | None:
    """Return the primary result code of an SQLite error (sqlite.org/rescode.html)."""
    code = getattr(error, "sqlite_errorcode", None)
    return None if code is None else code & 0xFF


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
