"""Files of earlier versions are converted, with a copy beside them; those of later ones stay untouched."""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gateway.cli.main import main
from gateway.errors import DamagedError, NewerError, StoreError
from gateway.storage.database import Connection, Database, read_file, stored_version
from gateway.storage.formats.catalogue import FORMATS, FileKind, Format
from gateway.storage.json_file import JsonFile
from gateway.storage.upkeep.versions import Pending, pending_in, refuse_newer
from tests.storage.store_rig import Things, insert, texts

JSON, SQLITE = "wear.json", "history.db"


class Power(BaseException):
    """The end of the process, at one point of a conversion."""


def rename_key(document: dict[str, Any]) -> dict[str, Any]:
    return {"writes": document["counts"]}


def upper(connection: Connection) -> None:
    connection.execute("UPDATE thing SET text = upper(text)")


def mark(connection: Connection) -> None:
    connection.execute("UPDATE thing SET text = text || '!'")


@pytest.fixture
def third(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let this program write version 3 of a database and version 2 of a document."""
    monkeypatch.setitem(FORMATS, SQLITE, Format(SQLITE, FileKind.SQLITE, (upper, mark)))
    monkeypatch.setitem(FORMATS, JSON, Format(JSON, FileKind.JSON, (rename_key,)))
    return


def database_with(folder: Path, text: str) -> Path:
    path = folder / SQLITE
    database = Database(path, [Things()], 2**20)
    assert database.open() == ""
    database.transact([insert(text)])
    database.close()
    return path


def rows_of(path: Path) -> list[str]:
    connection = sqlite3.connect(path)
    found = texts(connection)
    connection.close()
    return found


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def set_version(path: Path, version: int) -> None:
    connection = sqlite3.connect(path)
    connection.execute(f"PRAGMA user_version = {version}")
    connection.close()


def test_a_database_of_an_earlier_version_takes_every_step_and_leaves_a_copy(
    tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    path = database_with(tmp_path, "a")
    request.getfixturevalue("third")
    (tmp_path / f"{SQLITE}.0").touch()  # no copy of ours
    (tmp_path / f"{SQLITE}.7").touch()

    database = Database(path, [Things()], 2**20)
    assert database.open() == ""
    (converted,) = database.transact([texts])
    database.close()

    assert converted == ["A!"]
    assert stored_version(path) == 3
    assert rows_of(tmp_path / f"{SQLITE}.1") == ["a"]
    assert stored_version(tmp_path / f"{SQLITE}.1") == 1
    assert names(tmp_path) == {SQLITE, f"{SQLITE}.1", f"{SQLITE}.0"}
    assert (tmp_path / f"{SQLITE}.1").stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("step", ["copy", "in place", "first step", "second step", "forget"])
def test_wherever_a_conversion_is_cut_short_the_next_start_completes_it(
    step: str, tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = database_with(tmp_path, "a")
    request.getfixturevalue("third")

    def fail(*_: Any) -> None:
        raise Power

    with monkeypatch.context() as patch:
        match step:
            case "copy":
                patch.setattr("gateway.storage.database.mark_restored", fail)
            case "in place":
                patch.setattr("gateway.storage.database.put_in_place", fail)
            case "first step":
                patch.setitem(FORMATS, SQLITE, Format(SQLITE, FileKind.SQLITE, (fail, mark)))
            case "second step":
                patch.setitem(FORMATS, SQLITE, Format(SQLITE, FileKind.SQLITE, (upper, fail)))
            case _:
                patch.setattr("gateway.storage.database.forget_other_copies", fail)
        with pytest.raises(Power):
            Database(path, [Things()], 2**20).open()
    assert stored_version(path) == (3 if step == "forget" else 1)

    database = Database(path, [Things()], 2**20)
    assert database.open() == ""
    (converted,) = database.transact([texts])
    database.close()
    assert converted == ["A!"]
    assert rows_of(tmp_path / f"{SQLITE}.1") == ["a"]
    assert names(tmp_path) == {SQLITE, f"{SQLITE}.1"}


def test_a_database_whose_conversion_finds_no_room_stays_as_it_is(
    tmp_path: Path, third: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = database_with(tmp_path, "a")
    set_version(path, 1)
    (tmp_path / f"{SQLITE}.1.new").mkdir()  # nothing can be written there

    with pytest.raises(StoreError):
        Database(path, [Things()], 2**20).open()

    assert stored_version(path) == 1
    assert not list(tmp_path.glob("*.aside-*"))


def test_a_reader_beside_a_gateway_converts_nothing_and_says_so(tmp_path: Path, third: None) -> None:
    path = database_with(tmp_path, "a")
    set_version(path, 1)

    with pytest.raises(StoreError, match="has an earlier format"):
        read_file(path, texts)

    assert stored_version(path) == 1
    assert not (tmp_path / f"{SQLITE}.1").exists()


def test_a_document_is_converted_when_read_and_the_file_when_saved(tmp_path: Path, third: None) -> None:
    path = tmp_path / JSON
    path.write_text('{"counts": {"a": 1}}')
    (tmp_path / f"{JSON}.9").touch()
    file = JsonFile(path)

    assert file.load() == {"writes": {"a": 1}}
    assert path.read_text() == '{"counts": {"a": 1}}'  # a reader changes nothing
    file.write({"writes": {"a": 2}})

    assert json.loads(path.read_text()) == {"writes": {"a": 2}, "version": 2}
    assert (tmp_path / f"{JSON}.1").read_text() == '{"counts": {"a": 1}}'
    file.write({"writes": {"a": 3}})
    assert names(tmp_path) == {JSON, f"{JSON}.1"}


@pytest.mark.parametrize("step", ["write_copy", "write_whole", "forget_other_copies"])
def test_wherever_a_document_is_cut_short_the_file_is_of_one_version(
    step: str, tmp_path: Path, third: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / JSON
    path.write_text('{"counts": {"a": 1}}')

    def fail(*_: Any) -> None:
        raise Power

    with monkeypatch.context() as patch:
        patch.setattr(f"gateway.storage.json_file.{step}", fail)
        file = JsonFile(path)
        file.load()
        with pytest.raises(Power):
            file.write({"writes": {"a": 2}})

    again = JsonFile(path)
    assert again.load() == {"writes": {"a": 2 if step == "forget_other_copies" else 1}}
    again.write({"writes": {"a": 3}})
    assert JsonFile(path).load() == {"writes": {"a": 3}}
    assert json.loads((tmp_path / f"{JSON}.1").read_text()) == {"counts": {"a": 1}}


@pytest.mark.parametrize("version", [0, -1, "1", 1.5, None, True])
def test_a_version_that_is_none_is_damage(version: object, tmp_path: Path) -> None:
    path = tmp_path / JSON
    path.write_text(json.dumps({"version": version}))

    with pytest.raises(DamagedError):
        JsonFile(path).load()
    assert JsonFile(path).version() is None


def test_a_document_that_no_step_understands_is_damage(tmp_path: Path, third: None) -> None:
    (tmp_path / JSON).write_text('{"other": 1}')

    with pytest.raises(DamagedError, match="no format 1"):
        JsonFile(tmp_path / JSON).load()


def test_every_file_of_a_later_version_is_named_and_none_is_touched(tmp_path: Path) -> None:
    database_with(tmp_path, "a")
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


def test_what_the_next_start_converts_is_known_before(tmp_path: Path, third: None) -> None:
    path = database_with(tmp_path, "a")
    set_version(path, 2)
    (tmp_path / JSON).write_text('{"writes": {}, "version": 2}')

    assert pending_in(tmp_path) == [Pending(FORMATS[SQLITE], 2, path.stat().st_size)]
    assert pending_in(tmp_path / "nowhere") == []


def test_the_version_of_a_file_that_a_process_holds_is_read_from_its_header(tmp_path: Path) -> None:
    path = database_with(tmp_path, "a")
    holder = sqlite3.connect(path, isolation_level=None)
    holder.execute("PRAGMA locking_mode = EXCLUSIVE")
    holder.execute("INSERT INTO thing (text) VALUES ('b')")

    version = stored_version(path)
    holder.close()

    assert version == 1


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
