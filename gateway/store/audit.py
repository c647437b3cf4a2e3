"""The audit: a table of lines in a hash chain, of which the oldest go when it takes too much room.

The chain goes on where the table's last line stands, whatever happened to the file. What stands before the
first line is known from the anchor, which is written when lines are given up; so it shows when others were
removed. Entries wait in memory, a bounded number of them, while the disk is away.
"""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from gateway.contract import AuditRecord, rfc3339
from gateway.errors import UnstorableError
from gateway.store.chain import Head, link, read_line
from gateway.store.database import Connection, read_file, write_file
from gateway.store.schema import STATE
from gateway.store.worker import Store
from gateway.system.supervised import on_this_loop

T = TypeVar("T")

MOST_BYTES = 48 * 2**20  # of all lines
GIVEN_UP = 16  # of so many lines one goes when there is no room left
MOST_WAITING = 5_000  # entries; what is more is lost, and counted
MOST_AT_ONCE = 200

_LAST = "SELECT line FROM audit ORDER BY number DESC LIMIT 1"
_PUT = "INSERT INTO audit (line) VALUES (?)"
_LINES = """
    SELECT number, line FROM (SELECT number, line FROM audit ORDER BY number DESC LIMIT ?) ORDER BY number
"""
_OLDEST = "SELECT line FROM audit WHERE number = ?"
_GIVE_UP = "DELETE FROM audit WHERE number <= ?"
_SHARE = "SELECT coalesce(sum(length(line)), 0), min(number), max(number) FROM audit"
_ANCHOR = "SELECT body FROM documents WHERE name = 'audit'"
_PUT_ANCHOR = "REPLACE INTO documents VALUES ('audit', ?)"


class Anchor(NamedTuple):
    """Where the chain stood before its first line, and how long all lines are."""

    head: Head | None = Head()  # None: that is not known
    octets: int = 0


class Audit:
    """Takes entries in order; returns at once. All calls on the app's loop."""

    def __init__(self, store: Store, *, boot: str) -> None:
        self._store = store
        self._boot = boot
        self._waiting: deque[Mapping[str, Any]] = deque()
        self._latest: Future[None] | None = None
        self._lost = 0

    def put(self, record: AuditRecord) -> None:
        """Take a decision about a command."""
        said = record.fields()
        claims = {f"claimed_{claim}": said.pop(claim) for claim in ("operator", "reason")}
        self._take({"kind": "command", "boot": self._boot, **said, **claims})

    def note(self, code: str, text: str) -> None:
        """Take something that an auditor should know."""
        self._take(_note(code, text, self._boot))

    def resume(self) -> None:
        """Write what waits, if nothing is being written: a part at a time, each success starts the next."""
        if self._latest is not None or not self._waiting:
            return
        if self._lost:
            lost, self._lost = self._lost, 0
            self._waiting.append(_note("entries_lost", f"{lost} entries could not be stored", self._boot))
        entries = [self._waiting.popleft() for _ in range(min(len(self._waiting), MOST_AT_ONCE))]
        self._latest = self._store.submit(partial(append, entries=entries))
        self._latest.add_done_callback(on_this_loop(partial(self._written, entries)))

    def _take(self, entry: Mapping[str, Any]) -> None:
        if len(self._waiting) >= MOST_WAITING:
            self._lost += 1  # reported once there is room
        else:
            self._waiting.append(entry)
        if not self._store.trouble:
            self.resume()

    def _written(self, entries: Sequence[Mapping[str, Any]], future: Future[None]) -> None:
        self._latest = None
        error = future.exception()
        if error is None:
            self.resume()
        elif isinstance(error, UnstorableError):
            self._lost += len(entries)  # they would fail each time
        else:
            self._waiting.extendleft(reversed(entries))


def append(connection: Connection, *, entries: Sequence[Mapping[str, Any]]) -> None:
    """Add entries to the chain; give up the oldest when it has become too long."""
    anchor = _anchor(connection)
    head, octets = _head(connection, anchor), anchor.octets
    for entry in entries:
        line, head = link(head, entry)
        connection.execute(_PUT, (line,))
        octets += len(line)
    _put_anchor(connection, anchor._replace(octets=octets))
    while octets > MOST_BYTES:
        octets = _give_up_oldest(connection)


def take_over(connection: Connection, lines: Sequence[str], before: Head | None, text: str) -> None:
    """Begin an empty table with the lines of another audit, which stood at `before`, and a note of that."""
    connection.executemany(_PUT, ((line,) for line in lines))
    _put_anchor(connection, Anchor(before, sum(map(len, lines))))
    append(connection, entries=[_note("state_imported", text, "")])


def _give_up_oldest(connection: Connection) -> int:
    """Delete some lines, note what stands before those that are left, and return how long these are."""
    _, first, last = connection.execute(_SHARE).fetchone()
    gone = first + (last - first) // GIVEN_UP
    try:
        head: Head | None = read_line(str(connection.execute(_OLDEST, (gone,)).fetchone()[0]))[1]
    except (ValueError, TypeError):
        head = None
    connection.execute(_GIVE_UP, (gone,))
    octets: int = connection.execute(_SHARE).fetchone()[0]
    _put_anchor(connection, Anchor(head, octets))
    return octets


def read_audit(
    path: Path, work: Callable[[Anchor, Iterator[tuple[str, str]]], T], *, last: int | None = None
) -> T:
    """Do some work with the lines, each with its place, of a gateway's audit, also of one that runs.

    With `last` only so many, the newest. StoreError.
    """

    def read(connection: Connection) -> T:
        found = connection.execute(_LINES, (-1 if last is None else last,))
        return work(_anchor(connection), ((f"line {number}", str(line)) for number, line in found))

    return read_file(path, STATE, read)


def append_note(path: Path, code: str, text: str) -> None:
    """Add a note to the audit of a gateway that does not run; StoreError."""
    write_file(path, STATE, partial(append, entries=[_note(code, text, "")]))


def _note(code: str, text: str, boot: str) -> dict[str, Any]:
    return {"kind": "note", "boot": boot, "time": rfc3339(time.time()), "code": code, "text": text}


def _anchor(connection: Connection) -> Anchor:
    """Return the anchor; a damaged one anchors nothing."""
    row = connection.execute(_ANCHOR).fetchone()
    if row is None:
        return Anchor()
    try:
        fields = json.loads(row[0])
        return Anchor(Head(int(fields["n"]), str(fields["hash"])), int(fields["octets"]))
    except (ValueError, KeyError, TypeError):
        return Anchor(head=None)


def _head(connection: Connection, anchor: Anchor) -> Head:
    """Return where the chain stands; it begins anew where its last line is none, as verification shows."""
    row = connection.execute(_LAST).fetchone()
    if row is None:
        return anchor.head or Head()
    try:
        return read_line(str(row[0]))[1]
    except ValueError:
        return Head()


def _put_anchor(connection: Connection, anchor: Anchor) -> None:
    fields = {"n": anchor.head and anchor.head.number, "hash": anchor.head and anchor.head.hash}
    connection.execute(_PUT_ANCHOR, (json.dumps({**fields, "octets": anchor.octets}),))
