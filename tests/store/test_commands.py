"""What is written behind, such as commands: what reaches the disk, and what it may not take with it."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import partial
from typing import Any

from gateway.contract import Phase, ResultRecord
from gateway.errors import StoreError
from gateway.store.behind import Behind
from gateway.store.commands import CommandTable
from gateway.store.documents import put_body
from gateway.store.schema import STATE
from gateway.store.worker import Store
from tests.store.store_rig import PATIENCE_S
from tests.virtual_time import VirtualClock

NAMES = "SELECT name FROM documents ORDER BY name"


class FullStore:
    """A store whose disk is full until it is healed; `written` are the rows of commands since then."""

    trouble, lost_s = "", None

    def __init__(self) -> None:
        self.waiting: list[Future[Any]] = []
        self.written: list[str] = []
        self.is_full = True

    def submit(self, work: Callable[[Any], object], **_: object) -> Future[Any]:
        done = Future[Any]()
        if self.is_full:
            self.waiting.append(done)
        else:
            done.set_result(work(self))
        return done

    def execute(self, _: str, row: Sequence[Any] = ()) -> Sequence[Any]:
        if row:
            self.written.append(json.loads(row[-1])["phase"])
        return ()


async def test_when_the_disk_takes_neither_accepted_nor_the_end_the_end_is_written_later() -> None:
    store = FullStore()
    behind = Behind(store)  # type: ignore[arg-type]
    table = CommandTable(
        store,  # type: ignore[arg-type]
        behind,
        clock=VirtualClock(asyncio.get_running_loop()),
        hold_s=0.0,
        on_slow=lambda _: None,
    )
    published: list[Phase] = []
    for phase in (Phase.ACCEPTED, Phase.CONFIRMED):
        result = ResultRecord(
            starter="pump", client="alice", id="1", verb="start", phase=phase, code="ok", text="", time_s=0.0
        )
        table.note(result, then=lambda phase=phase: published.append(phase))  # type: ignore[misc]
    for done in store.waiting:
        done.set_exception(StoreError("the disk is full"))
    await asyncio.sleep(0.01)
    store.is_full = False
    behind.resume()
    await asyncio.sleep(0.01)

    assert published == [Phase.CONFIRMED]
    assert store.written == ["confirmed"]


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
