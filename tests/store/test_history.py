"""The history's file in its own thread."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from gateway.errors import StoreError
from gateway.store import HISTORY_FILE, HistoryRow, HistoryStore, News, read_history
from gateway.store.history import MOST_UNSAVED

PATIENCE_S = 10.0


class OpenHistory:
    """A store with its news."""

    def __init__(self, folder: Path) -> None:
        self.news: list[News] = []
        self.stored: list[str] = []  # ids
        self._changed = asyncio.Event()
        self.store = HistoryStore(folder / HISTORY_FILE)
        self.store.start(self._receive, lambda row: self.stored.append(row.id))

    def put(self, id_: str, *, kind: str = "start", starter: str = "p", limit: int = 3, **data: Any) -> None:
        self.store.put(HistoryRow(starter, kind, id_, data, limit), is_urgent=True)

    async def ids(self, starter: str = "p", kind: str = "start") -> list[str]:
        return [row.id for row in await self.store.rows(starter, (kind,))]

    async def until(self, news: News) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while news not in self.news:
                self._changed.clear()
                await self._changed.wait()

    def _receive(self, news: News, text: str) -> None:
        assert text
        assert threading.current_thread() is threading.main_thread()
        self.news.append(news)
        self._changed.set()


@pytest.fixture
async def opened(tmp_path: Path) -> AsyncIterator[OpenHistory]:
    here = OpenHistory(tmp_path)
    yield here
    assert await here.store.close(within_s=PATIENCE_S)


async def test_a_row_of_the_same_id_takes_the_place_of_the_one_before(opened: OpenHistory) -> None:
    for id_, value in (("a", 1), ("b", 2), ("a", 3)):
        opened.put(id_, value=value)
    opened.store.copy("p", "start", "a", "chosen")
    opened.store.copy("p", "start", "missing", "chosen")

    assert [(row.id, row.data) for row in await opened.store.rows("p", ())] == [
        ("a", {"value": 3}),
        ("b", {"value": 2}),
        ("a", {"value": 3}),
    ]


async def test_what_is_not_urgent_is_collected_into_one_transaction(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.store.history.COLLECT_S", 3600.0)
    here = OpenHistory(tmp_path)
    await here.until(News.OPEN)
    for number in range(100):
        here.store.put(HistoryRow("p", "counters", "now", {"n": number}))
    assert read_history(tmp_path, "p") == []

    here.put("a")  # takes everything before it along

    found = [(row.kind, row.data) for row in await here.store.rows("p", ())]
    assert found == [("counters", {"n": 99}), ("start", {})]
    await here.store.close(within_s=PATIENCE_S)


async def test_while_the_disk_is_away_rows_wait_in_bounded_memory_in_their_order(tmp_path: Path) -> None:
    folder = tmp_path / "state"
    folder.write_text("no folder")
    here = OpenHistory(folder)
    await here.until(News.AWAY)
    for number in range(MOST_UNSAVED + 10):
        here.put(str(number), limit=10_000)
    with pytest.raises(StoreError):
        await here.ids()
    here.store.copy("p", "start", "20", "chosen")
    assert here.stored == []

    folder.unlink()
    await here.until(News.BACK)

    assert await here.ids(kind="chosen") == ["20"]
    # The copy counts too.
    assert await here.ids() == [str(number) for number in range(11, MOST_UNSAVED + 10)]
    await here.store.close(within_s=PATIENCE_S)
