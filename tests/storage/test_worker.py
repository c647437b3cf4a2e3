"""The store on real files: what is stored, in which order, and what is bounded."""

from __future__ import annotations

import threading

import pytest

from gateway.errors import StoreError
from gateway.storage.database import Connection
from gateway.storage.worker import News
from tests.storage.store_rig import PATIENCE_S, Make, insert, texts


def test_work_is_done_in_the_order_in_which_it_was_submitted(keeping: Make) -> None:
    one = keeping()
    for number in range(2000):
        one.store.submit(insert(str(number)))

    assert one.do(texts) == [str(number) for number in range(2000)]


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


def test_only_so_much_waits(keeping: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.storage.worker.MOST_WAITING", 2)
    one = keeping()
    one.until(News.OPEN)
    gate, busy = threading.Event(), threading.Event()

    def hold(connection: Connection) -> None:
        busy.set()
        gate.wait(PATIENCE_S)

    one.store.submit(hold)
    assert busy.wait(PATIENCE_S)
    pieces = [one.store.submit(insert(str(number))) for number in range(3)]
    gate.set()

    with pytest.raises(StoreError, match="too much is waiting"):
        pieces[2].result(PATIENCE_S)
    assert pieces[1].result(PATIENCE_S) is None


def test_a_disk_that_does_not_answer_counts_as_away(keeping: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.storage.worker.HANG_S", 0.0)
    one = keeping()
    one.until(News.OPEN)
    gate, busy = threading.Event(), threading.Event()

    def hold(connection: Connection) -> None:
        busy.set()
        gate.wait(PATIENCE_S)

    held = one.store.submit(hold)
    assert busy.wait(PATIENCE_S)

    assert "has not answered" in one.store.trouble

    gate.set()
    held.result(PATIENCE_S)


def test_a_file_that_has_reached_its_bound_loses_its_oldest_rows_first(keeping: Make) -> None:
    one = keeping(max_bytes=40 * 4096)
    for number in range(500):
        one.do(insert(f"{number} {'x' * 900}"))

    stored = [int(text.split()[0]) for text in one.do(texts)]
    assert stored[-1] == 499
    assert 50 < len(stored) < 200
    assert stored == list(range(stored[0], 500))
    assert one.kinds() == [News.OPEN]


def test_what_can_never_fit_is_refused_and_the_rest_goes_on(keeping: Make) -> None:
    one = keeping(max_bytes=40 * 4096)

    with pytest.raises(StoreError, match="full"):
        one.do(insert("x" * 2**20))

    assert "full" in one.until(News.AWAY)
    one.store.submit(insert("a"))  # it may be too soon for this one
    while one.store.trouble:
        assert one.kinds().count(News.OPEN) <= 2
    one.do(insert("b"))
    assert one.do(texts)[-1] == "b"
