"""What 0.2.0 has left in `state_dir`, taken over once. To be removed in 0.4, with `state-of-0.2.0.tar.gz`.

0.2.0 had SQLite files of commands, messages and history, a JSON file for each document, and the audit in text
files. They are read and never changed, so that the way back starts on them. Each of our files appears whole
or not at all. A part that is damaged is left out, and what is left out is said; but a damaged document is
taken as it is, so that its reader finds the damage and acts on it (locks).

The audit's chain goes on: its newest lines are copied as they are, and those before them stay in the text
files, of which the anchor has the last hash. A result that 0.2.0 had not yet written to its outbox when it
was killed is not published; who repeats the command gets it.

Who went back to 0.2.0 and comes forward again has the newer state in these files: our own are then put aside.
"""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from gateway.errors import DamagedError, StoreError
from gateway.store import audit
from gateway.store.chain import Head, read_line
from gateway.store.commands import remembered
from gateway.store.database import Connection, Database, Schema, Work, put_aside, read_file
from gateway.store.outbox import DAMAGED, Deleted, Loss, OutboxRow, OutboxTable, Rank, losses_of
from gateway.store.schema import HISTORY, HISTORY_FILE, STATE, STATE_FILE
from gateway.store.worker import MAX_BYTES
from gateway.system.whole_files import NEW, put_in_place, sync_file

COMMANDS_0_2, OUTBOX_0_2, HISTORY_0_2 = "gateway.sqlite", "outbox.sqlite", "history.db"
SQLITE_0_2 = Schema("0.2.0", application_id=0x53474154, steps=(lambda _: None,))
AUDIT_0_2 = "audit"
AUDIT_BYTES = 8 * 2**20  # of lines that are taken over: starters wait while we do this

# By file: the document's name now, and the key under which it stood. None: all of it.
DOCUMENTS_0_2 = {
    "precautions.json": ("locks", None),
    "identities.json": ("fingerprints", "starters"),
    "watchdogs.json": ("watchdogs", "starters"),
    "faults.json": ("faults", "faults"),
    "wear.json": ("writes", "writes"),
    "home-assistant.json": ("announced", "topics"),
    "sparkplug/bdseq.json": ("births", "bdSeq"),
}

_DATABASES = (COMMANDS_0_2, OUTBOX_0_2, HISTORY_0_2)
_NAMES = re.compile("|".join(map(re.escape, (*_DATABASES, *DOCUMENTS_0_2))))
_AUDIT_NAMES = re.compile(rf"{AUDIT_0_2}/(audit-[0-9]{{8}}\.jsonl|anchor\.json)")
_COLUMNS = "client, id, starter, verb, phase, code, text, time_s, extra, may_be_written, is_final, since_s"
_RUN = "SELECT value FROM meta WHERE key = 'opened_s'"  # names the last run of 0.2.0
_PUT_RUN = "REPLACE INTO documents VALUES ('imported', ?)"
_IMPORTED_RUN = "SELECT body FROM documents WHERE name = 'imported'"


def is_file_of_0_2(name: str) -> bool:
    """Return whether 0.2.0 had a file of this name, relative to the state directory."""
    return bool(_NAMES.fullmatch(name) or _AUDIT_NAMES.fullmatch(name))


def files_of_0_2(state_dir: Path) -> list[str]:
    """Return the names of what 0.2.0 has left, relative to the state directory."""
    paths = (path for folder in ("", "audit/", "sparkplug/") for path in state_dir.glob(f"{folder}*"))
    names = (str(path.relative_to(state_dir)) for path in paths)
    return sorted(name for name in names if is_file_of_0_2(name))


def is_import_due(state_dir: Path) -> bool:
    """Return whether the newest state is that of 0.2.0."""
    if not files_of_0_2(state_dir):
        return False
    if not (state_dir / STATE_FILE).exists():
        return True
    try:
        imported = read_file(state_dir / STATE_FILE, STATE, partial(_ask, sql=_IMPORTED_RUN))
        return imported is not None and json.loads(imported) != _run_of(state_dir)
    except (StoreError, ValueError):
        return False


def import_files(state_dir: Path) -> list[str]:
    """Make our files of those of 0.2.0 if that is due; return what was damaged and left out. StoreError."""
    if not is_import_due(state_dir):
        return []
    run, problems = _run_of(state_dir), list[str]()
    history = partial(_read_history, state_dir, problems)
    _build(state_dir / HISTORY_FILE, HISTORY, [history])
    parts = (_read_commands, _read_outbox, _read_documents, _read_audit)
    works: list[Work] = [partial(part, state_dir, problems) for part in parts]
    works.append(lambda connection: connection.execute(_PUT_RUN, (json.dumps(run),)))
    _build(state_dir / STATE_FILE, STATE, works)  # the last, because it says that all is done
    return problems


def documents_of_0_2(state_dir: Path) -> dict[str, str]:
    """Return the documents in the files of 0.2.0, by name."""
    found = {}
    for file, (name, key) in DOCUMENTS_0_2.items():
        path = state_dir / file
        if path.is_file():
            try:
                text = path.read_bytes().decode("utf-8", "replace")
            except OSError as error:
                raise StoreError(f"{path}: {error.strerror}") from error
            found[name] = _document(name, key, text)
    return found


def _document(name: str, key: str | None, text: str) -> str:
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


def _build(path: Path, schema: Schema, works: Sequence[Work]) -> None:
    """Make a file, in one transaction; one that is there is put aside."""
    new = path.with_name(path.name + NEW)
    for each in path.parent.glob(f"{new.name}*"):
        each.unlink()
    database = Database(new, schema, max_bytes=MAX_BYTES)
    try:
        database.open()
        database.transact(works)
    finally:
        database.close()
    try:
        sync_file(new)
        if path.exists():
            put_aside(path)
        put_in_place(new, path)
    except OSError as error:
        raise StoreError(f"{error.filename or path}: {error.strerror}") from error


def _read_documents(state_dir: Path, problems: list[str], connection: Connection) -> None:
    for name, body in documents_of_0_2(state_dir).items():
        connection.execute("REPLACE INTO documents VALUES (?, ?)", (name, body))


def _read_commands(state_dir: Path, problems: list[str], connection: Connection) -> None:
    """Copy the commands, and whether their file was lost lately; it counts as lost now if it is damaged."""

    def read(old: Connection) -> tuple[list[Any], list[Any]]:
        marks = old.execute("SELECT key, value FROM meta WHERE key IN ('lost_s', 'restored_s')")
        return marks.fetchall(), old.execute(f"SELECT {_COLUMNS} FROM ledger ORDER BY rowid").fetchall()

    def copy(found: tuple[list[Any], list[Any]]) -> None:
        marks, rows = found
        for row in rows:
            remembered(row[:10])
        connection.executemany("REPLACE INTO meta VALUES (?, ?)", marks)
        connection.executemany(f"INSERT INTO commands ({_COLUMNS}) VALUES (?{', ?' * 11})", rows)

    if not _copied(state_dir / COMMANDS_0_2, read, copy, problems):
        connection.execute("REPLACE INTO meta VALUES ('restored_s', 0.0)")


def _read_outbox(state_dir: Path, problems: list[str], connection: Connection) -> None:
    """Copy what waits for the broker; rows that are damaged are declared as lost."""

    def read(old: Connection) -> tuple[list[Any], list[Any]]:
        rows = old.execute(
            "SELECT number, kind, topic, payload, time_s, boot, key, correlation, checksum FROM spool"
        ).fetchall()
        losses = old.execute(
            "SELECT reason, kind, count, coalesce(first_s, 0.0), coalesce(last_s, 0.0) FROM loss"
        )
        return rows, losses.fetchall()

    def copy(found: tuple[list[Any], list[Any]]) -> None:
        whole, damaged = list[OutboxRow](), list[Deleted]()
        for number, kind, *columns, checksum in found[0]:
            row = OutboxRow(number, Rank(kind), *columns)
            if checksum == _checksum(row):
                whole.append(row)
            else:
                damaged.append(Deleted(row.rank, number, row.size, 0.0))
        table = OutboxTable()
        table.insert(connection, whole)
        losses = [Loss(reason, Rank(kind), *columns) for reason, kind, *columns in found[1]]
        table.set_losses(connection, [*losses, *losses_of(DAMAGED, damaged)])

    _copied(state_dir / OUTBOX_0_2, read, copy, problems)


def _read_history(state_dir: Path, problems: list[str], connection: Connection) -> None:
    columns = "starter, kind, id, time_s, data"

    def read(old: Connection) -> list[Any]:
        return old.execute(f"SELECT {columns} FROM history ORDER BY number").fetchall()

    def copy(rows: list[Any]) -> None:
        connection.executemany(f"INSERT INTO history ({columns}) VALUES (?, ?, ?, ?, ?)", rows)

    _copied(state_dir / HISTORY_0_2, read, copy, problems)


def _read_audit(state_dir: Path, problems: list[str], connection: Connection) -> None:
    """Copy the newest lines of the audit, and say in it where they come from."""
    folder = state_dir / AUDIT_0_2
    try:
        number, before = _anchor(folder)
        lines = list(_lines(folder, number))
        if start := _newest(lines):
            before = read_line(lines[start - 1])[1]
    except (OSError, ValueError) as error:
        problems.append(f"{folder} was left out: {error}")
        return
    if lines:
        audit.take_over(connection, lines[start:], before, f"from {folder}, which 0.2.0 has written")


def _newest(lines: Sequence[str]) -> int:
    """Return from which line on they are taken over."""
    octets = 0
    for number in reversed(range(len(lines))):
        octets += len(lines[number])
        if octets > AUDIT_BYTES:
            return number + 1
    return 0


def _anchor(folder: Path) -> tuple[int, Head | None]:
    """Return the last file that was given up, and where the chain stood after it; None: not known."""
    try:
        fields = json.loads((folder / "anchor.json").read_text("utf-8"))
        return int(fields["segment"]), Head(int(fields["n"]), str(fields["hash"]))
    except FileNotFoundError:
        return 0, Head()
    except (ValueError, KeyError, TypeError):
        return 0, None


def _lines(folder: Path, after: int) -> Iterator[str]:
    """Yield all whole lines; a crash may have cut the last one of a file short."""
    for path in sorted(folder.glob("audit-????????.jsonl")):
        if path.name > f"audit-{after:08d}.jsonl":
            yield from path.read_bytes().decode("utf-8", "replace").split("\n")[:-1]


def _copied(
    path: Path, read: Callable[[Connection], Any], copy: Callable[[Any], None], problems: list[str]
) -> bool:
    """Read a file and copy what is in it; return False, with what is wrong among the problems, if damaged."""
    if not path.exists():
        return True
    try:
        copy(read_file(path, SQLITE_0_2, read))
    except (DamagedError, ValueError, TypeError) as error:
        problems.append(f"{path} was left out: {error}")
        return False
    return True


def _run_of(state_dir: Path) -> float | None:
    """Return what names the last run of 0.2.0; None when its file cannot tell."""
    try:
        return read_file(state_dir / COMMANDS_0_2, SQLITE_0_2, partial(_ask, sql=_RUN))
    except StoreError:
        return None


def _ask(connection: Connection, sql: str) -> Any:
    row = connection.execute(sql).fetchone()
    return None if row is None else row[0]


def _checksum(row: OutboxRow) -> int:
    fields = (int(row.rank), row.id, row.boot, row.topic, row.payload, row.correlation, row.key, row.time_s)
    return zlib.crc32(repr(fields).encode("utf-8", "backslashreplace"))
