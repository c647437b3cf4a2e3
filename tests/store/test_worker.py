"""The store on real files: what is stored, in which order, and what is bounded."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace

import pytest

from gateway.errors import StoreError
from gateway.store.database import PAGE_BYTES, SHRUNK_PAGES, Connection, FullError, Reserve
from gateway.store.worker import News
from tests.store.store_rig import PATIENCE_S, Keeping, Make, insert, texts


def test_a_bug_in_one_piece_of_work_corrupts_no_other(
    keeping: Make, caplog: pytest.LogCaptureFixture
) -> None:
    one = keeping()
    gate = threading.Event()
    one.store.submit(lambda connection: gate.wait(PATIENCE_S))
    pieces = [one.store.submit(work) for work in (insert("a"), lambda connection: 1 / 0, insert("b"))]
    bad_sql = one.store.submit(lambda connection: connection.execute("SELECT nonsense"))
    gate.set()

    for piece in (pieces[1], bad_sql):
        with pytest.raises(StoreError, match="inside the gateway"):
            piece.result(PATIENCE_S)
    assert one.do(texts) == ["a", "b"]
    assert one.kinds() == [News.OPEN]
    assert len(caplog.records) == 2


def held_up(one: Keeping) -> tuple[threading.Event, Future[None]]:
    """Let its thread be busy until the event is set; return that and the work."""
    gate, busy = threading.Event(), threading.Event()

    def hold(connection: Connection) -> None:
        busy.set()
        gate.wait(PATIENCE_S)

    held = one.store.submit(hold)
    assert busy.wait(PATIENCE_S)
    return gate, held


def test_only_so_much_waits(keeping: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.store.waiting.MOST_WAITING", 2)
    one = keeping()
    one.until(News.OPEN)
    gate, _ = held_up(one)
    pieces = [one.store.submit(insert(str(number))) for number in range(3)]
    gate.set()

    with pytest.raises(StoreError, match="too much is waiting"):
        pieces[2].result(PATIENCE_S)
    assert pieces[1].result(PATIENCE_S) is None


def test_a_disk_that_does_not_answer_counts_as_away(keeping: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.store.worker.HANG_S", 0.0)
    one = keeping()
    one.until(News.OPEN)
    gate, held = held_up(one)

    assert "has not answered" in one.store.trouble

    gate.set()
    held.result(PATIENCE_S)


def test_what_is_urgent_is_done_before_a_backlog_and_interrupts_a_batch(keeping: Make) -> None:
    one = keeping()
    gate, done = threading.Event(), list[str]()

    def step(name: str) -> Callable[[Connection], None]:
        return lambda connection: done.append(name)

    one.store.submit(lambda connection: gate.wait(PATIENCE_S))
    one.store.submit(lambda connection: one.store.submit(step("urgent"), is_urgent=True) and None)
    last = [one.store.submit(step(f"{number}")) for number in range(100)][-1]
    gate.set()
    last.result(PATIENCE_S)

    assert done == ["urgent", *map(str, range(100))]


def test_on_a_full_disk_only_deleting_goes_on_until_the_reserve_is_back(
    keeping: Make, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    one = keeping()
    one.do(insert("a"))
    has_room = False

    def write(connection: Connection) -> None:
        if not has_room:
            raise FullError("the disk is full")

    monkeypatch.setattr(Reserve, "take", lambda _: has_room)
    with pytest.raises(StoreError, match="full"):
        one.do(write)
    with pytest.raises(StoreError, match="full"):
        one.do(insert("b"))
    with pytest.raises(StoreError, match="inside the gateway"):
        one.store.submit(lambda _: 1 / 0, is_freeing=True).result(PATIENCE_S)
    freed = one.store.submit(lambda connection: connection.execute("DELETE FROM thing"), is_freeing=True)
    freed.result(PATIENCE_S)
    (reserve,) = tmp_path.rglob("*-reserve")

    assert one.kinds() == [News.OPEN, News.AWAY]
    assert reserve.stat().st_size == 0

    has_room = True
    while one.store.trouble:
        pass
    assert one.do(texts) == []
    assert one.kinds() == [News.OPEN, News.AWAY, News.OPEN]


def test_a_full_disk_gets_the_room_back_that_deleting_has_freed(
    keeping: Make, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def fill(connection: Connection) -> None:
        for _ in range(SHRUNK_PAGES):
            insert("a" * PAGE_BYTES)(connection)

    def find_it_full(_: Connection) -> None:
        raise FullError("the disk is full")

    one = keeping()
    one.do(fill)
    monkeypatch.setattr(Reserve, "take", lambda _: False)
    with pytest.raises(StoreError, match="full"):
        one.do(find_it_full)
    for _ in range(3):  # so many pages at most are given back each time
        freed = one.store.submit(lambda connection: connection.execute("DELETE FROM thing"), is_freeing=True)
        freed.result(PATIENCE_S)
    (file,) = tmp_path.rglob("*.sqlite")

    assert file.stat().st_size < 10 * PAGE_BYTES


def test_a_disk_that_stays_full_is_reported_once(keeping: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    one = keeping()
    one.do(insert("a"))

    def write(connection: Connection) -> None:
        raise FullError("the disk is full")

    monkeypatch.setattr(os, "statvfs", lambda _: SimpleNamespace(f_bavail=200, f_frsize=4096))
    until_s = time.monotonic() + 0.2  # ten attempts
    while time.monotonic() < until_s:
        with pytest.raises(StoreError, match="full"):
            one.do(write)

    assert one.kinds() == [News.OPEN, News.AWAY]

    monkeypatch.undo()
    while one.store.trouble:
        pass
    assert one.kinds() == [News.OPEN, News.AWAY, News.OPEN]


def test_what_did_not_fit_on_the_disk_gives_its_room_back(
    keeping: Make, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def room(_: Path) -> SimpleNamespace:
        left = 4 * 2**20 - sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file())
        return SimpleNamespace(f_bavail=left, f_frsize=1)

    def too_much(connection: Connection) -> None:
        for _ in range(250):
            insert("x" * 10_000)(connection)
        raise FullError("the disk is full")

    monkeypatch.setattr(os, "statvfs", room)
    one = keeping(max_bytes=2**23)
    with pytest.raises(StoreError, match="full"):
        one.do(too_much)
    until_s = time.monotonic() + PATIENCE_S
    while one.store.trouble:
        assert time.monotonic() < until_s

    assert one.do(texts) == []


def test_urgent_work_for_which_there_was_no_time_keeps_its_place(keeping: Make) -> None:
    one = keeping()
    gate, _ = held_up(one)
    begun, go = threading.Event(), threading.Event()

    def slow(connection: Connection) -> None:
        begun.set()
        go.wait(PATIENCE_S)

    one.store.submit(slow, is_urgent=True)
    one.store.submit(insert("accepted"), is_urgent=True)
    gate.set()
    assert begun.wait(PATIENCE_S)
    one.store.submit(insert("confirmed"), is_urgent=True)
    go.set()

    assert one.do(texts) == ["accepted", "confirmed"]
