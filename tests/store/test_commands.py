"""The table of commands: which of its results reaches the disk."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any

from gateway.contract import Phase, ResultRecord
from gateway.errors import StoreError
from gateway.store.commands import CommandTable
from tests.virtual_time import VirtualClock


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
    table = CommandTable(
        store,  # type: ignore[arg-type]
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
    table.resume()
    await asyncio.sleep(0.01)

    assert published == [Phase.CONFIRMED]
    assert store.written == ["confirmed"]
