"""Files of later versions stay untouched."""

from __future__ import annotations

import json
import os
import sqlite3
from pathlib import Path

import pytest
from gateway.storage.json_file import JsonFile
from gateway.storage.ledger_table import LedgerTable

from gateway.cli.main import main
from gateway.errors import DamagedError, NewerError
from gateway.storage.database import Database, stored_version
from gateway.storage.upkeep.versions import refuse_newer

JSON, SQLITE = "wear.json", "history.db"


def make_database(folder: Path) -> None:
    database = Database(folder / SQLITE, [LedgerTable()], 2**20)
    assert database.open() == ""
    database.close()


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def set_version(path: Path, version: int) -> None:
    connection = sqlite3.connect(path)
    connection.execute(f"PRAGMA user_version = {version}")
    connection.close()


@pytest.mark.parametrize("version", [0, -1, "1", 1.5, None, True])
def test_a_version_that_is_none_is_damage(version: object, tmp_path: Path) -> None:
    path = tmp_path / JSON
    path.write_text(json.dumps({"version": version}))

    with pytest.raises(DamagedError):
        JsonFile(path).load()
    assert JsonFile(path).version() is None


def test_every_file_of_a_later_version_is_named_and_none_is_touched(tmp_path: Path) -> None:
    make_database(tmp_path)
    set_version(tmp_path / SQLITE, 4)
    (tmp_path / JSON).write_text('{"version": 2}')
    (tmp_path / "faults.json").write_text("damaged")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    with pytest.raises(NewerError) as error:
        refuse_newer(tmp_path)

    assert [line.partition(" (")[0] for line in str(error.value).splitlines()] == [
        f"{tmp_path / SQLITE} has format 4, and this program knows formats up to 1",
        f"{tmp_path / JSON} has format 2, and this program knows formats up to 1",
    ]
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_run_ends_with_78_for_a_state_of_a_later_version(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("faulthandler.enable", lambda: None)  # pytest has its own
    monkeypatch.setattr("gateway.cli.run.log_to_stderr", lambda **_: None)
    config = tmp_path / "site.toml"
    config.write_text(
        '[gateway]\nname = "a"\nstate_dir = "state"\n[mqtt]\nurl = "mqtt://localhost"\n'
        '[[line]]\nname = "l"\nport = "/dev/null"\nbaud = 9600\nframing = "8N2"\n'
        '[[line.starter]]\nname = "s"\naddress = 1\nfamily = "ssw07"\n'
    )
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "identities.json").write_text('{"version": 2}')

    assert main(["run", str(config)]) == 78

    assert "identities.json has format 2" in capsys.readouterr().err
    assert names(tmp_path / "state") == {"identities.json", "gateway.lock"}


def test_a_pipe_in_the_place_of_a_file_is_no_reason_to_wait(tmp_path: Path) -> None:
    for name in (JSON, SQLITE):
        os.mkfifo(tmp_path / name)

    refuse_newer(tmp_path)

    assert JsonFile(tmp_path / JSON).version() is None
    assert stored_version(tmp_path / SQLITE) is None
