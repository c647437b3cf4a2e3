"""The history's file in its own thread."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from gateway.errors import StoreError
from gateway.storage.history import MOST_UNSAVED, HistoryStore, read_history
from gateway.store import News

PATIENCE_S = 10.0


class OpenHistory:
    """A store with its news."""

    def __init__(self, folder: Path, *, collect_s: float = 0.0) -> None:
        self.news: list[News] = []
        self._changed = asyncio.Event()
        self.store = HistoryStore(folder, on_news=self._receive, retry_s=0.02, collect_s=collect_s)
        self.store.start()

    def put(self, id_: str, *, kind: str = "start", starter: str = "p", limit: int = 3, **data: Any) -> None:
        self.store.put(starter, kind, id_, time_s=1.0, data=data, limit=limit, is_urgent=True)

    async def ids(self, starter: str = "p", kind: str = "start") -> list[str]:
        return [row.id for row in (await self.store.load([starter])).get(starter, []) if row.kind == kind]

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
    assert await here.store.close(PATIENCE_S)


async def test_the_newest_of_a_kind_stay_for_each_starter(opened: OpenHistory) -> None:
    for number in range(10):
        opened.put(str(number))
    opened.put("only", kind="month")
    opened.put("other", starter="q")

    assert await opened.ids() == ["7", "8", "9"]
    assert await opened.ids(kind="month") == ["only"]
    assert await opened.ids("q") == ["other"]


async def test_a_row_of_the_same_id_takes_the_place_of_the_one_before(opened: OpenHistory) -> None:
    opened.put("a", value=1)
    opened.put("b", value=2)
    opened.put("a", value=3)

    assert await opened.ids() == ["a", "b"]
    row = await opened.store.row("p", "start", "a")
    assert row is not None
    assert row.data == {"value": 3}
    assert await opened.store.row("p", "start", "c") is None


async def test_what_is_not_urgent_is_collected_into_one_transaction(tmp_path: Path) -> None:
    here = OpenHistory(tmp_path, collect_s=3600.0)
    await here.until(News.OPEN)
    for number in range(100):
        here.store.put("p", "counters", "now", time_s=1.0, data={"n": number}, limit=1)
    assert read_history(tmp_path, "p") == []

    here.put("a")  # takes everything before it along

    assert [(r.kind, r.data) for r in (await here.store.load())["p"]] == [
        ("counters", {"n": 99}),
        ("start", {}),
    ]
    await here.store.close(PATIENCE_S)


async def test_while_the_disk_is_away_rows_wait_in_bounded_memory_in_their_order(tmp_path: Path) -> None:
    folder = tmp_path / "state"
    folder.write_text("no folder")
    here = OpenHistory(folder)
    await here.until(News.AWAY)
    for number in range(MOST_UNSAVED + 10):
        here.put(str(number), limit=10_000)
    with pytest.raises(StoreError):
        await here.store.load()

    folder.unlink()
    await here.until(News.OPEN)

    ids = await here.ids()
    assert sorted(ids, key=int) == [str(number) for number in range(10, MOST_UNSAVED + 10)]
    assert here.store.lost_rows == 10
    await here.store.close(PATIENCE_S)
