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

from gateway.home_assistant.announcements import Announcements
from gateway.starters.identity.registry import known_from
from gateway.starters.policy.motor_history import MotorHistory
from gateway.starters.policy.write_budget import totals_in
from gateway.starters.telemetry.known_watchdogs import KnownWatchdogs
from gateway.starters.telemetry.transitions import PublishedFaults
from gateway.storage.audit.chain import Head, verify
from gateway.storage.audit.segments import FOLDER, lines
from gateway.storage.database import Database, SqlTable
from gateway.storage.formats import STATE_FILES, FileKind
from gateway.storage.history_table import HistoryTable
from gateway.storage.json_file import JsonFile
from gateway.storage.ledger_table import LedgerTable
from gateway.storage.outbox_table import OutboxTable
from gateway.storage.upkeep.versions import found_in, refuse_newer
from gateway.system.clock_steps import ClockReading
from tests.starters.plant import FakeMemory
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


def keys_in(value: Any) -> Any:
    """Return the shape of a document: keys and types, for its tables by name only one entry."""
    if isinstance(value, dict):
        return {key: keys_in(each) for key, each in value.items()}
    return type(value).__name__


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


async def test_the_documents_are_understood_and_written_in_the_same_shape(state: Path) -> None:
    found = {name: JsonFile(path_of(state, name)).load() or {} for name in DOCUMENTS}
    reading = ClockReading(up_s=10.0, utc_s=2e9, boot_id="other")
    history = MotorHistory(["pump", "mill", "fan", "belt"])
    history.restore(found["precautions.json"], now_s=5.0, reading=reading)
    watchdogs = KnownWatchdogs(memory=FakeMemory(found["watchdogs.json"]))
    faults = PublishedFaults(memory=FakeMemory(found["faults.json"]))

    lock = history.lock_of("mill")
    assert lock is not None
    assert (lock.by, lock.reason, lock.operator) == ("alice", "bearing", "Ann")
    assert len(history.starts_since("belt", -4000.0)) == 1
    assert faults.has("fan", ("fault",))
    assert totals_in(found["wear.json"]) == {"pump": 1}
    assert Announcements(found["home-assistant.json"]).document() == found["home-assistant.json"]
    assert watchdogs.to_document() == found["watchdogs.json"]
    assert faults.to_document() == found["faults.json"]
    assert found["bdseq.json"]["bdSeq"] >= 0
    again = history.to_document(now_s=6.0, reading=reading)
    assert keys_in(again) == keys_in({"version": 1, **found["precautions.json"]})
    known = {name: known_from(each) for name, each in found["identities.json"]["starters"].items()}
    assert {name: each and each.as_data() for name, each in known.items()} == found["identities.json"][
        "starters"
    ]


def test_the_audit_is_whole(state: Path) -> None:
    verification = verify(lines(state / FOLDER), after=Head())

    assert verification.problems == ()
    assert verification.count > 5
