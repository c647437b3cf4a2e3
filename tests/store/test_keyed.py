"""Work with a key: it outlasts a bad disk, the newest of each key wins, and a bug takes no other along."""

from __future__ import annotations

import asyncio
import gc
import threading

import pytest
from pydantic import TypeAdapter

from gateway.errors import StoreError
from gateway.store.database import Connection, Database, FullError
from gateway.store.documents import Documents
from gateway.store.schema import STATE
from gateway.store.worker import News, Store
from tests.store.store_rig import PATIENCE_S, Make, insert, texts


@pytest.fixture
def bad_disk(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A disk on which nothing can be written until `undo`."""

    def transact(*_: object, **__: object) -> None:
        raise FullError("the disk is full")

    monkeypatch.setattr(Database, "transact", transact)
    return monkeypatch


def test_what_the_disk_has_missed_is_stored_once_it_is_well_the_newest_of_each_key(
    keeping: Make, bad_disk: pytest.MonkeyPatch
) -> None:
    one = keeping()
    first, other, newer = (
        one.store.submit(insert(text), key=("thing", key), is_urgent=text == "c")
        for text, key in (("a", "1"), ("b", "2"), ("c", "1"))
    )
    with pytest.raises(StoreError, match="full"):
        one.do(insert("without a key"))
    one.until(News.AWAY)
    assert one.store.unsaved == 2

    bad_disk.undo()

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


def test_of_each_table_the_oldest_keys_go_when_too_many_wait(keeping: Make) -> None:
    one = keeping(most_keys=3)
    gate = threading.Event()
    one.store.submit(lambda connection: gate.wait(PATIENCE_S) and None, is_urgent=True)
    pieces = [one.store.submit(insert(f"{n}"), key=("thing", f"{n}"), within_s=1.0) for n in range(5)]
    one.store.submit(insert("x"), key=("other", "1"))
    gate.set()

    for piece in pieces[:2]:
        with pytest.raises(StoreError, match="too much is waiting"):
            piece.result(PATIENCE_S)
    assert one.do(texts) == ["2", "3", "4", "x"]


def test_a_bug_in_work_with_a_key_takes_no_other_with_it(keeping: Make) -> None:
    one = keeping()
    pieces = [
        one.store.submit(insert(f"{n}") if n != 4 else lambda _: 1 / 0, key=("thing", f"{n}"))
        for n in range(9)
    ]

    with pytest.raises(StoreError, match="inside the gateway"):
        pieces[4].result(PATIENCE_S)
    assert "".join(one.do(texts)) == "01235678"


@pytest.mark.usefixtures("bad_disk")
async def test_a_document_that_cannot_be_saved_leaves_no_error_behind(
    caplog: pytest.LogCaptureFixture,
) -> None:
    store = Store(None, STATE)
    document = Documents(store).open("locks", TypeAdapter(dict[str, int]), lambda: {"a": 1})
    store.start(lambda *_: None)
    store.submit(lambda _: None).exception(PATIENCE_S)
    document.touch()

    is_saved = await document.saved(within_s=PATIENCE_S)
    store.close(within_s=PATIENCE_S)
    await asyncio.sleep(0)
    gc.collect()

    assert not is_saved
    assert "never retrieved" not in caplog.text
