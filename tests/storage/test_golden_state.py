"""A state directory as version 0.2.0 left it: today's program reads it, and 0.2.0 could read it again.

The fixture was made by 0.2.0: four simulated starters, a start, a stop, a lock, a setting, a fault, and a
broker that went away. 0.2.0 knows no versions but `application_id` with `user_version` 1, and takes another
version or another shape for damage; its documents may have more keys, except precautions.json. A change of
what is expected here is a change of format.
"""

from __future__ import annotations

import asyncio
import json
import sqlite3
from pathlib import Path
from typing import Any

import pytest

from gateway.storage.audit.chain import Head, verify
from gateway.storage.audit.segments import FOLDER, lines
from gateway.storage.database import Database, SqlTable
from gateway.storage.formats import STATE_FILES, FileKind
from gateway.storage.history_table import HistoryTable
from gateway.storage.json_file import JsonFile
from gateway.storage.ledger_table import LedgerTable
from gateway.storage.outbox_table import OutboxTable
from gateway.storage.upkeep.versions import found_in, refuse_newer
from tests.storage.golden.state import unpack_golden

TABLES: dict[str, SqlTable] = {
    "gateway.sqlite": LedgerTable(),
    "outbox.sqlite": OutboxTable(),
    "history.db": HistoryTable(),
}
DOCUMENTS = [name for name, each in STATE_FILES.items() if each.kind is FileKind.JSON]


@pytest.fixture
def state(tmp_path: Path) -> Path:
    return unpack_golden(tmp_path / "state")


def path_of(state: Path, name: str) -> Path:
    return state / STATE_FILES[name].name


def shape(path: Path) -> dict[str, Any]:
    """Return everything that 0.2.0 demands of a database."""
    connection = sqlite3.connect(path)
    tables = {
        name: [column[1:4] + column[5:] for column in connection.execute(f"PRAGMA table_info({name})")]
        for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
    }
    marks = [
        connection.execute(f"PRAGMA {mark}").fetchone()[0] for mark in ("application_id", "user_version")
    ]
    connection.close()
    return {"tables": tables, "marks": marks}


def test_every_file_of_it_counts_as_version_1(state: Path) -> None:
    refuse_newer(state)

    assert {each.name: version for each, version in found_in(state)} == {
        each.name: 1 for each in STATE_FILES.values()
    }


@pytest.mark.parametrize("name", TABLES)
def test_a_database_is_opened_as_it_is_and_stays_one_that_the_earlier_version_opens(
    name: str, state: Path, tmp_path: Path
) -> None:
    path, before = path_of(state, name), shape(path_of(state, name))
    for each in (path, tmp_path / name):  # the one of before, and a new one
        database = Database(each, [TABLES[name]], 2**26)
        assert database.open() == ""
        assert database.lost_s is None
        database.close()

    assert shape(path) == before == shape(tmp_path / name)
    assert before["marks"] == [0x53474154, 1]


@pytest.mark.parametrize("name", DOCUMENTS)
def test_a_document_is_saved_with_the_keys_that_it_had_and_its_version(name: str, state: Path) -> None:
    path = path_of(state, name)
    before = json.loads(path.read_text())
    file = JsonFile(path)

    document = file.load()
    assert document is not None
    asyncio.run(file.save(document))

    assert json.loads(path.read_text()) == {**before, "version": 1}


def test_the_audit_is_whole(state: Path) -> None:
    verification = verify(lines(state / FOLDER), after=Head())

    assert verification.problems == ()
    assert verification.count > 5
