"""A journal on a disk of its own."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gateway.records import Phase, ResultRecord
from gateway.storage.journal import Remembered
from gateway.storage.ledger import StoredJournal
from gateway.storage.ledger_table import LedgerTable
from gateway.storage.worker import News, Store
from gateway.system.clock import SystemClock

PATIENCE_S = 10.0


def result(id_: str | None, phase: Phase = Phase.ACCEPTED, **more: Any) -> ResultRecord:
    fields = {
        "starter": "pump-1",
        "client": "alice",
        "verb": "start",
        "code": "ok",
        "text": "",
        "time_s": 5.0,
    }
    return ResultRecord(id=id_, phase=phase, **{**fields, **more})


@dataclass
class JournalRun:
    """One run of a gateway as far as its journal goes."""

    path: Path
    hold_s: float = 0.0
    news: list[News] = field(default_factory=list)
    slow: list[str] = field(default_factory=list)
    recalled: list[Remembered] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._changed = asyncio.Event()
        table = LedgerTable()
        self.store = Store(self.path, [table], retry_s=0.02)
        self.journal = StoredJournal(
            self.store,
            table,
            clock=SystemClock(),
            hold_s=self.hold_s,
            on_slow=self.slow.append,
        )
        self.journal.on_recalled = self._recall

    def start(self) -> None:
        self.store.start(self._from_thread)

    async def begin(self) -> JournalRun:
        """Start, and wait until the ledger has been read."""
        self.start()
        await self.until(
            lambda: bool(self.recalled) or not self.journal.trouble or "lost" in self.journal.trouble
        )
        return self

    async def until(self, is_true: Callable[[], bool]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not is_true():
                self._changed.clear()
                await self._changed.wait()

    async def note(self, noted: ResultRecord) -> None:
        """Note, and wait until that is on the disk."""
        reported = asyncio.Event()
        self.journal.note(noted, then=reported.set)
        async with asyncio.timeout(PATIENCE_S):
            await reported.wait()

    async def end(self) -> None:
        await asyncio.to_thread(self.store.close, within_s=PATIENCE_S)

    def ids(self) -> list[str | None]:
        return [remembered.result.id for remembered in self.recalled]

    def _recall(self, commands: Sequence[Remembered]) -> None:
        self.recalled = list(commands)
        self._changed.set()

    def _from_thread(self, news: News, text: str) -> None:
        self._loop.call_soon_threadsafe(self._receive, news)

    def _receive(self, news: News) -> None:
        self.news.append(news)
        if news is News.OPEN:
            self.journal.resume()
        self._changed.set()
