"""The store on real files: what is stored, in which order, what is bounded, and what a bad disk costs."""

from __future__ import annotations

import errno
import fcntl
import os
import random
import sqlite3
import threading
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from types import SimpleNamespace

import pytest

from gateway.errors import StoreError
from gateway.store import News
from gateway.store.database import PAGE_BYTES, SHRUNK_PAGES, Connection, Database, FullError
from tests.store.store_rig import PATIENCE_S, Keeping, Make, insert, texts


def full(_: object, *__: object, **___: object) -> None:
    raise FullError("the disk is full")


def delete(connection: Connection) -> None:
    connection.execute("DELETE FROM thing")


def held_up(one: Keeping) -> threading.Event:
    """Let its thread be busy until the event is set."""
    gate, busy = threading.Event(), threading.Event()

    def hold(connection: Connection) -> None:
        busy.set()
        gate.wait(PATIENCE_S)

    one.store.submit(hold)
    assert busy.wait(PATIENCE_S)
    return gate


def test_a_bug_in_one_piece_of_work_takes_no_other_with_it(
    keeping: Make, caplog: pytest.LogCaptureFixture
) -> None:
    one = keeping()
    gate = held_up(one)
    bugs = (lambda _: 1 / 0, lambda connection: connection.execute("SELECT nonsense"))
    bad = [one.store.submit(bug, key=key) for bug in bugs for key in (None, ("thing", f"{bug}"))]
    for number in range(9):
        one.store.submit(insert(f"{number}"), key=("thing", f"{number}"))
    gate.set()

    for piece in bad:
        with pytest.raises(StoreError, match="inside the gateway"):
            piece.result(PATIENCE_S)
    assert "".join(one.do(texts)) == "012345678"
    assert one.kinds() == [News.OPEN]
    assert len(caplog.records) == len(bad)


def test_what_the_disk_has_missed_is_stored_once_it_is_well_the_newest_of_each_key(
    keeping: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Database, "transact", full)
    one = keeping()
    first, other, newer = (
        one.store.submit(insert(text), key=("thing", key), is_urgent=text == "c")
        for text, key in (("a", "1"), ("b", "2"), ("c", "1"))
    )
    with pytest.raises(StoreError, match="full"):
        one.do(insert("without a key"))
    one.until(News.AWAY)
    assert one.store.unsaved == 2

    monkeypatch.undo()

    assert [future.result(PATIENCE_S) for future in (first, other, newer)] == [None] * 3
    assert one.do(texts) == ["c", "b"]
    assert one.store.unsaved == 0


def test_work_that_comes_while_that_of_its_key_is_being_done_is_done_after_it(keeping: Make) -> None:
    one = keeping()
    begun, go = threading.Event(), threading.Event()

    def slow(connection: Connection) -> None:
        insert("older")(connection)
        begun.set()
        go.wait(PATIENCE_S)

    older = one.store.submit(slow, key=("thing", "1"))
    assert begun.wait(PATIENCE_S)
    one.store.submit(insert("newer"), key=("thing", "1"), within_s=3600.0)
    go.set()
    older.result(PATIENCE_S)

    assert one.do(texts) == ["older", "newer"]


def test_the_oldest_of_a_table_goes_when_too_much_of_it_waits(keeping: Make) -> None:
    one = keeping(most_waiting=5)
    gate = held_up(one)
    other = one.store.submit(insert("other"), key=("documents", "a"))
    pieces = [
        one.store.submit(insert(f"{n}"), key=("thing", f"{n}"), is_urgent=n in (0, 5)) for n in range(7)
    ]
    gate.set()

    for piece in pieces[:2]:
        with pytest.raises(StoreError, match="too much is waiting"):
            piece.result(PATIENCE_S)
    other.result(PATIENCE_S)
    assert one.do(texts) == ["5", "other", "2", "3", "4", "6"]


def test_an_intent_goes_before_the_results_that_wait(keeping: Make) -> None:
    one = keeping()
    gate = held_up(one)
    one.store.submit(insert("final"), key=("thing", "1"), is_urgent=True)
    one.store.submit(insert("intent"), is_urgent=True)
    gate.set()

    assert one.do(texts) == ["intent", "final"]


def test_work_that_its_caller_has_given_up_is_not_done(keeping: Make) -> None:
    one = keeping()
    gate = held_up(one)
    pieces = [one.store.submit(insert(text), is_urgent=True) for text in ("a", "b")]
    assert pieces[0].cancel()
    gate.set()

    assert one.do(texts) == ["b"]


def test_a_disk_that_does_not_answer_counts_as_away(keeping: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.store.worker.HANG_S", 0.0)
    one = keeping()
    one.until(News.OPEN)
    gate = held_up(one)

    assert "has not answered" in one.store.trouble
    assert one.store.is_unreadable
    gate.set()


def test_what_is_urgent_is_done_before_a_backlog_and_interrupts_a_batch(keeping: Make) -> None:
    one, done = keeping(), list[str]()

    def step(name: str) -> Callable[[Connection], None]:
        return lambda connection: done.append(name)

    gate = held_up(one)
    one.store.submit(lambda connection: one.store.submit(step("urgent"), is_urgent=True) and None)
    last = [one.store.submit(step(f"{number}")) for number in range(100)][-1]
    gate.set()
    last.result(PATIENCE_S)

    assert done == ["urgent", *map(str, range(100))]


# A disk that is full.


def test_a_reserve_is_held_where_the_c_library_has_to_write_it_itself(
    keeping: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    def emulated(descriptor: int, at: int, count: int) -> None:
        if fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_APPEND:  # [posix_fallocate(3)], without the kernel's
            raise OSError(errno.EBADF, "Bad file descriptor")
        os.pwrite(descriptor, bytes(count), at)

    monkeypatch.setattr(os, "posix_fallocate", emulated)

    assert keeping().do(texts) == []


def test_on_a_full_disk_only_deleting_goes_on_until_the_reserve_is_back(
    keeping: Make, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    one = keeping()
    one.do(insert("a"))
    monkeypatch.setattr(os, "statvfs", lambda _: SimpleNamespace(f_bavail=200, f_frsize=4096))
    for work in (full, insert("b")):
        with pytest.raises(StoreError, match="full"):
            one.do(work)
    with pytest.raises(StoreError, match="inside the gateway"):
        one.store.submit(lambda _: 1 / 0, is_freeing=True).result(PATIENCE_S)
    one.store.submit(delete, is_freeing=True).result(PATIENCE_S)
    (reserve,) = tmp_path.rglob("*-reserve")

    assert one.kinds() == [News.OPEN, News.AWAY]
    assert reserve.stat().st_size == 0
    assert not one.store.is_unreadable

    monkeypatch.undo()
    one.until(News.BACK)
    assert one.do(texts) == []
    assert one.kinds() == [News.OPEN, News.AWAY, News.BACK]
    assert reserve.stat().st_size == 2**20


def test_a_full_disk_gets_the_room_back_that_deleting_has_freed(
    keeping: Make, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def fill(connection: Connection) -> None:
        for _ in range(SHRUNK_PAGES):
            insert("a" * PAGE_BYTES)(connection)

    one = keeping()
    one.do(fill)
    monkeypatch.setattr(os, "statvfs", lambda _: SimpleNamespace(f_bavail=200, f_frsize=4096))
    with pytest.raises(StoreError, match="full"):
        one.do(full)
    for _ in range(3):  # so many pages at most are given back each time
        one.store.submit(delete, is_freeing=True).result(PATIENCE_S)
    (file,) = tmp_path.rglob("*.sqlite")

    assert file.stat().st_size < 10 * PAGE_BYTES


def test_what_did_not_fit_on_the_disk_gives_its_room_back(
    keeping: Make, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def room(_: Path) -> SimpleNamespace:
        left = 4 * 2**20 - sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file())
        return SimpleNamespace(f_bavail=left, f_frsize=1)

    def too_much(connection: Connection) -> None:
        for _ in range(250):
            insert("x" * 10_000)(connection)
        full(connection)

    monkeypatch.setattr(os, "statvfs", room)
    one = keeping()
    with pytest.raises(StoreError, match="full"):
        one.do(too_much)
    one.until(News.BACK)

    assert one.do(texts) == []


# A file that is damaged, in use, or of a later version.


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
        "PRAGMA user_version = 0",
        "PRAGMA user_version = -1",
        "DROP TABLE thing",
        "ALTER TABLE thing RENAME COLUMN text TO other",
    ],
)
def test_a_database_of_another_shape_is_put_aside(keeping: Make, path: Path, sql: str) -> None:
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute(sql)

    one = keeping(path)
    one.do(insert("a"))

    assert one.do(texts) == ["a"]
    assert "put aside as x.sqlite.aside" in one.until(News.LOST)


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
    lasting = one.store.submit(insert("a"), key=("thing", "1"), within_s=3600.0)
    one.do(lambda connection: connection.execute("PRAGMA shrink_memory").fetchall())
    with path.open("r+b") as file:
        file.seek(4096)
        file.write(b"\xff" * 4096 * 8)
    Path(f"{path}-wal").write_bytes(b"")
    with suppress(StoreError):
        one.do(texts)
    assert path.exists()  # else an import of an earlier version's files would take its place meanwhile
    one.until(News.LOST)
    lasting.result(PATIENCE_S)

    one.do(insert("c"))
    assert one.do(texts)[-1] == "c"


def test_a_transaction_that_sqlite_has_rolled_back_by_itself_is_not_taken_for_a_commit(
    keeping: Make, path: Path
) -> None:
    def lost(connection: sqlite3.Connection) -> None:
        insert("a")(connection)
        connection.rollback()  # as SQLite does when the disk fails [sqlite.org/lang_transaction.html 3]

    one = keeping(path)
    before = one.do(texts)

    with pytest.raises(Exception, match="no transaction is active"):
        one.do(lost)
    assert one.do(texts) == before


def test_a_file_that_another_process_holds_is_waited_for_not_put_aside(
    keeping: Make, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.store.database.LOCKED_WITHIN_S", 0.01)
    with closing(sqlite3.connect(path, isolation_level=None)) as holder:
        holder.execute("PRAGMA locking_mode = EXCLUSIVE")
        holder.execute("INSERT INTO thing (text) VALUES ('a')")
        second = keeping(path)
        second.until(News.AWAY)
    second.until(News.BACK)

    assert second.do(texts)[-1] == "a"
    assert not list(path.parent.glob("*.aside*"))


def test_a_file_of_a_later_version_is_away_and_stays_as_it_is(keeping: Make, path: Path) -> None:
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA user_version = 2")

    one = keeping(path)

    assert "has format 2, and this program knows formats up to 1" in one.until(News.AWAY)
    assert not list(path.parent.glob("*.aside*"))
    assert path.read_bytes()[60:64] == b"\0\0\0\2"  # its version
