"""The state that 0.2.0 has left in `state_dir`, imported once. To be removed in 0.4, with its test's archive.

0.2.0 had SQLite files of commands, messages and history, a JSON file for each document, and the audit in text
files. They are read and never changed, so that the way back starts on them. Each of our files appears whole
or not at all. A part that is damaged is left out, and the journal says so; but a damaged document is taken as
it is, so that its reader finds the damage and acts on it (locks).

The audit's chain goes on: its newest lines are copied as they are, and those before them stay in the text
files, of which the anchor has the last hash. A result that 0.2.0 had not yet written to its outbox when it
was killed is not published; who repeats the command gets it.

As long as the import fails, as on a full disk, our files are not opened: they count as away, starts are
refused, and the import is tried again.

After a way back to 0.2.0 and forward again the newer state is in these files: our own are then put aside.
"""

from __future__ import annotations

import json
import logging
import os
import threading
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from fnmatch import fnmatchcase
from functools import partial
from itertools import accumulate, count
from pathlib import Path
from typing import Any

from gateway.errors import StoreError
from gateway.store import audit
from gateway.store.chain import Head, canonical, read_line
from gateway.store.commands import remembered
from gateway.store.database import (
    Connection,
    FullError,
    Schema,
    put_aside,
    read_file,
    translated,
    write_file,
)
from gateway.store.outbox import Loss, OutboxRow, OutboxTable, Rank, merged
from gateway.store.schema import HISTORY, SCHEMAS, STATE, STATE_FILE
from gateway.system.whole_files import NEW, put_in_place, sync_file

log = logging.getLogger(__name__)

MOST_SEGMENTS = 2  # of the audit, 4 MiB each, are imported: starters wait meanwhile

# By file: the document's name now, and the key under which it stood. None: all of it.
DOCUMENTS = {
    "precautions.json": ("locks", None),
    "identities.json": ("fingerprints", "starters"),
    "watchdogs.json": ("watchdogs", "starters"),
    "faults.json": ("faults", "faults"),
    "wear.json": ("writes", "writes"),
    "home-assistant.json": ("announced", "topics"),
    "sparkplug/bdseq.json": ("births", "bdSeq"),
}
COMMANDS, OUTBOX, HISTORY_0_2 = DATABASES = ("gateway.sqlite", "outbox.sqlite", "history.db")
ANCHOR, SEGMENTS = "audit/anchor.json", "audit/audit-????????.jsonl"
NAMES = (*DATABASES, *(f"{name}-wal" for name in DATABASES), *DOCUMENTS, ANCHOR, SEGMENTS)
SQLITE_0_2 = Schema("0.2.0", steps=(lambda _: None,))

_RUN = "SELECT value FROM meta WHERE key = 'opened_s'"  # names the last run of 0.2.0
_SAID = ("verb", "phase", "code", "text", "time_s")  # of a command
_COMMANDS = (
    f"SELECT client, id, starter, may_be_written, extra, {', '.join(_SAID)} FROM ledger ORDER BY rowid"
)
_MESSAGES = "SELECT kind, number, topic, payload, time_s, boot, key, correlation, checksum FROM spool"
_LOSSES = "SELECT reason, kind, count, coalesce(first_s, 0.0), coalesce(last_s, 0.0) FROM loss"
_HISTORY = "starter, kind, id, time_s, data"
_IMPORTING = threading.Lock()  # each of our files has a thread

_PUT_DOCUMENT = "REPLACE INTO documents VALUES (?, ?)"
_IMPORTED = "SELECT body FROM documents WHERE name = 'imported'"


def is_file_of_0_2(name: str) -> bool:
    """Return whether 0.2.0 had a file of this name, relative to the state directory."""
    return any(fnmatchcase(name, pattern) for pattern in NAMES)


def files_of_0_2(state_dir: Path) -> list[str]:
    """Return the names of what 0.2.0 has left, relative to the state directory."""
    return sorted(str(path.relative_to(state_dir)) for name in NAMES for path in state_dir.glob(name))


def is_import_due(state_dir: Path) -> bool:
    """Return whether the newest state is that of 0.2.0."""
    if not files_of_0_2(state_dir):
        return False
    if not (state_dir / STATE_FILE).exists():
        return True
    try:
        found = read_file(state_dir / STATE_FILE, STATE, lambda file: file.execute(_IMPORTED).fetchone())
        return found is not None and found[0] != _run_of(state_dir)
    except StoreError:
        return False


def import_files(state_dir: Path | None) -> None:
    """Make our files of those of 0.2.0 if that is due; None: there are none. StoreError.

    Where it fails, nothing is changed, and it is due again.
    """
    with _IMPORTING:
        if state_dir is not None and is_import_due(state_dir):
            _demand_room(state_dir)
            for name, schema in SCHEMAS.items():
                _build(state_dir / f"{name}{NEW}", schema, state_dir)
            for name in SCHEMAS:
                _put_in_place(state_dir / name)


def documents_of_0_2(state_dir: Path) -> dict[str, str]:
    """Return the documents in the files of 0.2.0, by name. StoreError."""
    with translated(state_dir):
        found = {file: (state_dir / file).read_bytes() for file in DOCUMENTS if (state_dir / file).is_file()}
    return {DOCUMENTS[file][0]: _document(file, octets) for file, octets in found.items()}


def _document(file: str, octets: bytes) -> str:
    """Return a document as it is written now; one that is damaged stays as it is."""
    (name, key), text = DOCUMENTS[file], octets.decode("utf-8", "replace")
    try:
        content = json.loads(text)
        content.pop("version", None)
        document = content if key is None else content[key]
        if name == "fingerprints":
            document = {
                starter: {"despite_model": known.pop("despite_model"), "fingerprint": known}
                for starter, known in document.items()
            }
        return json.dumps(document)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return text


def _demand_room(state_dir: Path) -> None:
    """Raise StoreError where the copies would fill the disk, and wear it out at each attempt."""
    with translated(state_dir):
        sizes = [(state_dir / name).stat().st_size for name in DATABASES if (state_dir / name).exists()]
        needed = 2 * sum(sizes)  # in the write-ahead log and in the file
        disk = os.statvfs(state_dir)
    if disk.f_bavail * disk.f_frsize < needed:
        raise StoreError(f"{state_dir}: the import of what 0.2.0 has stored needs {needed / 2**20:.1f} MiB")


def _build(new: Path, schema: Schema, state_dir: Path) -> None:
    """Make one of our files under another name, in one transaction. StoreError."""
    try:
        with translated(new):
            _remove(new)
            write_file(new, schema, partial(_copy, schema=schema, state_dir=state_dir))
            sync_file(new)
    except StoreError:
        with suppress(OSError):
            _remove(new)  # it takes the room that others need
        raise


def _remove(new: Path) -> None:
    for each in new.parent.glob(f"{new.name}*"):
        each.unlink()


def _put_in_place(path: Path) -> None:
    """Give a file its name; one that is there is put aside. StoreError."""
    with translated(path):
        if path.exists():
            put_aside(path)
        put_in_place(path.with_name(path.name + NEW), path)


def _copy(connection: Connection, *, schema: Schema, state_dir: Path) -> None:
    """Copy each part that can be read."""
    for part in PARTS[schema]:
        try:
            part(state_dir, connection)
        except FullError:
            raise  # ours has no room
        except (StoreError, OSError, ValueError, TypeError) as error:
            log.error("upgrade: left out of what 0.2.0 had stored: %s", error)  # noqa: TRY400 - one line


def _copy_commands(state_dir: Path, connection: Connection) -> None:
    """Copy the commands, all or none."""
    path, commands = state_dir / COMMANDS, []
    for client, id_, starter, may_be_written, extra, *said in _read(path, _COMMANDS):
        result = dict(zip(_SAID, said, strict=True), starter=starter, values=json.loads(extra))
        commands.append((client, id_, starter, may_be_written, json.dumps(result)))
        remembered(client, id_, may_be_written, json.dumps(result))
    connection.executemany("INSERT INTO commands VALUES (?, ?, ?, ?, ?)", commands)


def _copy_outbox(state_dir: Path, connection: Connection) -> None:
    """Copy what waits for the broker; rows that are damaged are declared as lost."""
    table, lost = OutboxTable(), list[Loss]()

    def whole(found: Iterable[Any]) -> Iterator[OutboxRow]:
        for kind, number, *columns, checksum in found:
            row = OutboxRow(number, Rank(kind), *columns)
            if checksum == _checksum(row):
                yield row
            else:
                lost.append(Loss("damaged", row.rank, 1, 0.0, 0.0))

    _read(state_dir / OUTBOX, _MESSAGES, lambda found: table.insert(connection, whole(found)))
    earlier = _read(state_dir / OUTBOX, _LOSSES)
    lost += (Loss(reason, Rank(kind), *columns) for reason, kind, *columns in earlier)
    table.set_losses(connection, merged(lost))


def _copy_documents(state_dir: Path, connection: Connection) -> None:
    """Copy the documents, and note of which run of 0.2.0 all of this is."""
    imported = ("imported", _run_of(state_dir))
    connection.executemany(_PUT_DOCUMENT, [*documents_of_0_2(state_dir).items(), imported])


def _copy_history(state_dir: Path, connection: Connection) -> None:
    put = f"INSERT INTO history ({_HISTORY}) VALUES (?, ?, ?, ?, ?)"
    rows = f"SELECT {_HISTORY} FROM history ORDER BY number"
    _read(state_dir / HISTORY_0_2, rows, lambda found: connection.executemany(put, found))


def _copy_audit(state_dir: Path, connection: Connection) -> None:
    """Copy the newest lines of the audit, and say in it where they come from."""
    given_up, before = _anchor(state_dir / ANCHOR)
    segments = [path for path in sorted(state_dir.glob(SEGMENTS)) if path.name > given_up]
    older, newest = segments[:-MOST_SEGMENTS], segments[-MOST_SEGMENTS:]
    if older:
        before = _last_head(older[-1])
    if newest:
        lines = [line for path in newest for line in _lines(path)]
        anchor = canonical({"n": before.number, "hash": before.hash})
        rows = zip(count(), (anchor, *lines), (0, *accumulate(map(len, lines))), strict=False)
        connection.executemany("INSERT INTO audit (number, line, upto) VALUES (?, ?, ?)", rows)
        text = f"from {state_dir}/audit, which 0.2.0 has written"
        audit.append(connection, entry=audit.note_of("state_imported", text, ""))


PARTS = {STATE: (_copy_commands, _copy_outbox, _copy_documents, _copy_audit), HISTORY: (_copy_history,)}


def _anchor(path: Path) -> tuple[str, Head]:
    """Return the last file that was given up, and the place in the chain after it."""
    try:
        fields = json.loads(path.read_text("utf-8"))
        return f"audit-{fields['segment']:08d}.jsonl", Head(int(fields["n"]), str(fields["hash"]))
    except (FileNotFoundError, ValueError, KeyError, TypeError):
        return "", Head()


def _lines(path: Path) -> list[str]:
    """Return all whole lines; a crash may have cut the last one short."""
    return path.read_bytes().decode("utf-8", "replace").split("\n")[:-1]


def _last_head(path: Path) -> Head:
    """Return the place in the chain after a file."""
    try:
        return read_line(_lines(path)[-1])[1]
    except (IndexError, ValueError):
        return Head()


def _run_of(state_dir: Path) -> str:
    """Return what names the last run of 0.2.0, as far as its file says."""
    try:
        return json.dumps(_read(state_dir / COMMANDS, _RUN))
    except StoreError:
        return json.dumps(None)


def _read(path: Path, sql: str, work: Callable[[Iterable[Any]], Any] = list) -> Any:
    """Do some work with the rows of a file of 0.2.0; with none when there is no file. StoreError."""
    if not path.exists():
        return work(())
    return read_file(path, SQLITE_0_2, lambda file: work(file.execute(sql)))


def _checksum(row: OutboxRow) -> int:
    fields = (int(row.rank), row.id, row.boot, row.topic, row.payload, row.correlation, row.key, row.time_s)
    return zlib.crc32(repr(fields).encode("utf-8", "backslashreplace"))
