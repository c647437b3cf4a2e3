"""Files of the state directory are for their owner alone."""

from __future__ import annotations

import ast
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from gateway.storage.audit.segments import Anchor, write_anchor
from gateway.storage.json_file import JsonFile
from gateway.storage.ledger_table import LedgerTable
from gateway.storage.state_dir import OWN_NAMES, keep_private

from gateway.storage.database import Database


@pytest.fixture(autouse=True)
def open_umask() -> Iterator[None]:
    before = os.umask(0o022)
    yield
    os.umask(before)


def modes(folder: Path) -> set[int]:
    return {path.stat().st_mode & 0o777 for path in folder.rglob("*") if path.is_file()}


def test_files_that_an_earlier_version_left_readable_become_private(tmp_path: Path) -> None:
    (tmp_path / "audit").mkdir()
    for name in ("gateway.sqlite", "audit/anchor.json"):
        (tmp_path / name).write_text("x")
        (tmp_path / name).chmod(0o644)

    keep_private(tmp_path)

    assert modes(tmp_path) == {0o600}


def test_files_that_are_made_later_are_private_too(tmp_path: Path) -> None:
    keep_private(tmp_path)

    JsonFile(tmp_path / "precautions.json").write({"version": 1})
    write_anchor(tmp_path, Anchor())
    database = Database(tmp_path / "gateway.sqlite", [LedgerTable()], 2**20)
    database.open()

    assert {path.name for path in tmp_path.iterdir()} >= {"gateway.sqlite", "gateway.sqlite-wal"}
    assert modes(tmp_path) == {0o600}
    database.close()


def test_files_of_others_in_the_same_folder_keep_their_modes(tmp_path: Path) -> None:
    others = [
        tmp_path / name for name in ("run.sh", "site.toml", "notes.json", "tools/gateway.sqlite", "tools/x")
    ]
    (tmp_path / "tools").mkdir()
    for path in others:
        path.write_text("x")
        path.chmod(0o755)

    keep_private(tmp_path)

    assert {path.stat().st_mode & 0o777 for path in others} == {0o755}


def test_every_file_that_the_gateway_stores_there_is_known_as_its_own() -> None:
    names = {
        node.value.value
        for path in (Path(__file__).parents[2] / "gateway").rglob("*.py")
        for node in ast.parse(path.read_text("utf-8")).body
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant)
        if any(isinstance(target, ast.Name) and target.id.endswith("FILE") for target in node.targets)
        if str(node.value.value).endswith((".json", ".sqlite", ".db", ".lock"))
    }

    assert {"gateway.sqlite", "history.db", "wear.json", "gateway.lock"} <= names
    assert all(OWN_NAMES.fullmatch(name) for name in names), names
    assert OWN_NAMES.fullmatch("gateway.sqlite-wal")
    assert OWN_NAMES.fullmatch("wear.json.damaged-2")
