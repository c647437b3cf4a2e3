"""Writing behind: work with a bug takes no other with it, and the rows of a disk hold the rest."""

from __future__ import annotations

import asyncio
import gc
from functools import partial

import pytest
from pydantic import TypeAdapter

from gateway.errors import StoreError
from gateway.store.behind import Behind
from gateway.store.database import Connection, Database, FullError
from gateway.store.documents import Documents, put_body
from gateway.store.schema import STATE
from gateway.store.worker import Store
from gateway.system.supervised import on_this_loop
from tests.store.store_rig import PATIENCE_S

NAMES = "SELECT name FROM documents ORDER BY name"


async def test_one_document_with_a_bug_takes_no_other_with_it() -> None:
    store, lost = Store(None, STATE), asyncio.Event()
    behind = Behind(store, on_lost=lost.set)
    for number in range(9):
        work = partial(put_body, name=str(number), body="x")
        behind.put(number, work if number != 4 else lambda _: 1 / 0)
    store.start(lambda *_: None)
    await lost.wait()
    found = await asyncio.wrap_future(store.submit(lambda file: file.execute(NAMES).fetchall()))
    store.close(within_s=PATIENCE_S)

    assert "".join(name for (name,) in found) == "01235678"


async def test_what_a_store_with_too_much_to_do_refuses_is_tried_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("gateway.store.behind.RETRY_S", 0.02)
    store = Store(None, STATE)
    store.start(lambda *_: None)
    behind = Behind(store)
    written = asyncio.Event()
    note_written = on_this_loop(written.set)

    def write(connection: Connection) -> None:
        put_body(connection, name="a", body="x")
        note_written()

    with monkeypatch.context() as full:
        full.setattr("gateway.store.worker.MOST_WAITING", 0)
        refused = behind.put_now("a", write)
    with pytest.raises(StoreError, match="too much is waiting"):
        refused.result(PATIENCE_S)

    await asyncio.wait_for(written.wait(), PATIENCE_S)
    found = await asyncio.wrap_future(store.submit(lambda file: file.execute(NAMES).fetchall()))
    store.close(within_s=PATIENCE_S)

    assert found == [("a",)]


async def test_a_document_that_cannot_be_saved_leaves_no_error_behind(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def transact(*_: object, **__: object) -> None:
        raise FullError("the disk is full")

    store = Store(None, STATE)
    store.start(lambda *_: None)
    document = Documents(Behind(store)).open("locks", TypeAdapter(dict[str, int]), lambda: {"a": 1})
    await asyncio.wrap_future(store.submit(lambda _: None))
    monkeypatch.setattr(Database, "transact", transact)
    document.touch()

    is_saved = await document.saved()
    store.close(within_s=PATIENCE_S)
    await asyncio.sleep(0)
    gc.collect()

    assert not is_saved
    assert "never retrieved" not in caplog.text
