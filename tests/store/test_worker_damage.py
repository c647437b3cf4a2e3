"""A store whose file is foreign, damaged, gone, locked or on a bad disk: it never prevents anything."""

from __future__ import annotations

import random
import sqlite3
import time
from contextlib import suppress
from pathlib import Path

import pytest

from gateway.errors import StoreError
from gateway.store.database import stored_version
from gateway.store.worker import News
from tests.store.store_rig import PATIENCE_S, THINGS, Keeping, Make, insert, texts


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file with 200 rows that was closed in order."""
    path = tmp_path / "x.sqlite"
    one = Keeping(path)
    for number in range(200):
        one.do(insert(f"{number} {'x' * 100}"))
    one.close()
    return path


@pytest.mark.parametrize(
    "sql",
    [
        "PRAGMA application_id = 7",
        "PRAGMA user_version = 0",
        "DROP TABLE thing",
        "ALTER TABLE thing RENAME COLUMN text TO other",
    ],
)
def test_a_database_of_another_shape_is_put_aside_or_repaired(keeping: Make, path: Path, sql: str) -> None:
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA writable_schema = 1")
    connection.execute(sql)
    connection.commit()
    connection.close()

    one = keeping(path)
    one.do(insert("a"))

    assert one.do(texts) == ["a"]


def test_a_file_corrupted_in_any_way_never_prevents_the_start(keeping: Make, path: Path) -> None:
    dice = random.Random(1)
    whole = path.read_bytes()
    for round_ in range(60):
        corrupted = bytearray(whole)
        match round_ % 5:
            case 0:
                del corrupted[dice.randrange(1, len(corrupted)) :]
            case 1:
                for _ in range(dice.choice((1, 10, 1000))):
                    corrupted[dice.randrange(len(corrupted))] = dice.randrange(256)
            case 2:
                begin = dice.randrange(len(corrupted) - 512)
                corrupted[begin : begin + 512] = bytes(512)
            case 3:
                at = dice.choice((*range(60), *range(64, 100)))  # its version may become a later one
                corrupted[at] ^= 1 << dice.randrange(8)
            case 4:
                corrupted[18] = 3  # of no version that SQLite can write [fileformat.html 1.3.4]
        path.write_bytes(corrupted)
        Path(f"{path}-wal").write_bytes(dice.randbytes(round_ * 100))

        one = keeping(path)
        one.do(insert("a"))
        assert one.do(texts)[-1] == "a"
        one.close()

    assert {each.name for each in path.parent.glob("*.aside*")} <= {"x.sqlite.aside", "x.sqlite.aside-wal"}


def test_a_file_corrupted_while_it_is_in_use_is_put_aside(keeping: Make, path: Path) -> None:
    one = keeping(path)
    one.do(insert("a"))
    one.do(lambda connection: connection.execute("PRAGMA shrink_memory").fetchall())
    with path.open("r+b") as file:
        file.seek(4096)
        file.write(b"\xff" * 4096 * 8)
    Path(f"{path}-wal").write_bytes(b"")

    until_s = time.monotonic() + PATIENCE_S
    while News.LOST not in one.kinds() and time.monotonic() < until_s:
        with suppress(StoreError):
            one.do(insert("b"))
            one.do(texts)

    one.do(insert("c"))
    assert one.do(texts)[-1] == "c"


def test_a_file_that_another_process_holds_is_waited_for_not_put_aside(
    keeping: Make, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.store.database.LOCKED_WITHIN_S", 0.01)
    holder = sqlite3.connect(path, isolation_level=None)
    holder.execute("PRAGMA locking_mode = EXCLUSIVE")
    holder.execute("INSERT INTO thing (text) VALUES ('a')")

    second = keeping(path)
    text = second.until(News.AWAY)
    holder.close()
    second.until(News.OPEN)

    assert "in use by another process" in text
    assert second.do(texts)[-1] == "a"
    assert not list(path.parent.glob("*.aside*"))


def test_a_file_of_a_later_version_is_away_and_stays_as_it_is(keeping: Make, path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA user_version = 2")
    connection.close()

    one = keeping(path)
    text = one.until(News.AWAY)

    assert "has format 2, and this program knows formats up to 1" in text
    assert not list(path.parent.glob("*.aside*"))
    assert stored_version(path, THINGS) == 2
