"""The audit: a table of lines in a hash chain, of which the oldest go when it takes too much room.

The chain goes on behind the table's last line, whatever happened to the file. The place before the first line
is known from the anchor, row 0, which is the last line that was given up; so it shows when others were
removed. A row says how long all lines up to it are together: to add one touches this table alone.
Entries wait in memory, a bounded number of them, until they are written, which they do not hurry.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, TypeVar

from gateway.contract import AuditRecord, Record, rfc3339, stored
from gateway.store.chain import Head, link, read_line
from gateway.store.database import Connection, read_file, write_file
from gateway.store.schema import STATE
from gateway.store.worker import BEHIND_S, Store
from gateway.system.supervised import on_this_loop

T = TypeVar("T")

MOST_BYTES = 48 * 2**20  # of all lines
GIVEN_UP = 16  # of so many lines one goes when there is no room left

_LAST = "SELECT line, upto FROM audit ORDER BY number DESC LIMIT 1"
_ANCHOR = "SELECT line, upto FROM audit WHERE number = 0"
_PUT = "INSERT INTO audit (line, upto) VALUES (?, ?)"
_LINES = """
    SELECT number, line FROM
    (SELECT number, line FROM audit WHERE number > 0 ORDER BY number DESC LIMIT ?) ORDER BY number
"""
_UPTO = "SELECT number FROM audit WHERE upto >= ? AND number > 0 ORDER BY number LIMIT 1"
_GIVE_UP = "DELETE FROM audit WHERE number < ?"
_BE_ANCHOR = "UPDATE audit SET number = 0 WHERE number = ?"


class Audit:
    """Takes entries in order; returns at once. All calls on the app's loop."""

    takes = (AuditRecord,)

    def __init__(self, store: Store, *, boot: str) -> None:
        self._store = store
        self._boot = boot
        self._numbers = count()  # of entries, which all wait
        self._lost = 0

    def put(self, record: Record) -> None:
        """Take a decision about a command."""
        said = stored(record)
        claims = {f"claimed_{claim}": said.pop(claim) for claim in ("operator", "reason")}
        self._take({"kind": "command", "boot": self._boot, **said, **claims})

    def note(self, code: str, text: str) -> None:
        """Take something that an auditor should know."""
        self._take(note_of(code, text, self._boot))

    def _take(self, entry: Mapping[str, Any]) -> None:
        key = ("audit", str(next(self._numbers)))
        done = self._store.submit(partial(append, entry=entry), key=key, within_s=BEHIND_S)
        done.add_done_callback(on_this_loop(self._note_end))

    def _note_end(self, future: Future[None]) -> None:
        if future.exception() is not None:
            self._lost += 1
        elif self._lost:  # now that something can be stored again
            lost, self._lost = self._lost, 0
            self.note("entries_lost", f"{lost} entries could not be stored")


def append(connection: Connection, *, entry: Mapping[str, Any]) -> None:
    """Add an entry to the chain; give up the oldest when it has become too long."""
    head, upto = _place(connection, _LAST)
    line, _ = link(head, entry)
    upto += len(line)
    connection.execute(_PUT, (line, upto))
    if upto - _place(connection, _ANCHOR)[1] > MOST_BYTES:
        last = connection.execute(_UPTO, (upto - MOST_BYTES + MOST_BYTES // GIVEN_UP,)).fetchone()
        connection.execute(_GIVE_UP, last)
        connection.execute(_BE_ANCHOR, last)


def read_audit(path: Path, work: Callable[[Head, Iterator[tuple[str, str]]], T], *, last: int = -1) -> T:
    """Do some work with the lines, each with its name, of a gateway's audit, also of one that runs.

    It gets the place before them. With `last` only so many, the newest. StoreError.
    """

    def read(connection: Connection) -> T:
        lines = ((f"line {number}", str(line)) for number, line in connection.execute(_LINES, (last,)))
        return work(_place(connection, _ANCHOR)[0], lines)

    return read_file(path, STATE, read)


def append_note(path: Path, code: str, text: str) -> None:
    """Add a note to the audit of a gateway that does not run; StoreError."""
    write_file(path, STATE, partial(append, entry=note_of(code, text, "")))


def note_of(code: str, text: str, boot: str) -> dict[str, Any]:
    """Return an entry that says something to an auditor."""
    return {"kind": "note", "boot": boot, "time": rfc3339(time.time()), "code": code, "text": text}


def _place(connection: Connection, sql: str) -> tuple[Head, int]:
    """Return the place behind a row, and how long all lines up to there are.

    Where there is no line, or a damaged one, the chain restarts, as verification shows.
    """
    line, upto = connection.execute(sql).fetchone() or ("", 0)
    try:
        return read_line(line)[1], upto
    except ValueError:
        return Head(), upto
