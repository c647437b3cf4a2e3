"""The outbox's file in its own thread."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import pytest

from gateway.errors import StoreError
from gateway.storage.outbox import FILE, OutboxDisk
from gateway.storage.spool import Changes, Kind, Row
from gateway.storage.worker import News

PATIENCE_S = 10.0


def row(number: int, kind: Kind = Kind.EVENT) -> Row:
    return Row(number, kind, "run", "b/event", str(number).encode(), None, "", 5.0)


class Opened:
    """A disk with its news."""

    def __init__(self, folder: Path, **limits: int) -> None:
        self.disk = OutboxDisk(folder, retry_s=0.02, **limits)
        self.news: list[News] = []
        self._changed = asyncio.Event()

    async def until(self, news: News) -> Opened:
        async with asyncio.timeout(PATIENCE_S):
            while news not in self.news:
                self._changed.clear()
                await self._changed.wait()
        return self

    async def open(self) -> Opened:
        self.disk.start(self._receive)
        return await self.until(News.OPEN)

    async def close(self) -> None:
        assert await self.disk.close(PATIENCE_S)

    def _receive(self, news: News, text: str) -> None:
        assert text
        assert threading.current_thread() is threading.main_thread()
        self.news.append(news)
        self._changed.set()


async def test_a_file_that_is_full_makes_room_and_says_what_it_cost(tmp_path: Path) -> None:
    opened = await Opened(tmp_path, max_bytes=64 * 1024).open()
    await opened.disk.recall()
    losses = []
    for number in range(1, 400, 10):
        rows = tuple(row(number + more)._replace(payload=b"x" * 500) for more in range(10))
        losses += await opened.disk.apply(Changes(rows))
    shares = (await opened.disk.recall()).shares
    await opened.close()

    assert (tmp_path / FILE).stat().st_size <= 64 * 1024
    assert sum(loss.rows for loss in losses) == 400 - shares[Kind.EVENT].rows > 0
    assert opened.news == [News.OPEN]


async def test_a_place_that_cannot_be_made_is_reported_and_found_again(tmp_path: Path) -> None:
    place = tmp_path / "state"
    place.touch()
    opened = Opened(place)
    opened.disk.start(opened._receive)
    await opened.until(News.AWAY)
    assert "state" in opened.disk.trouble
    with pytest.raises(StoreError):
        await opened.disk.recall()

    place.unlink()
    await opened.until(News.OPEN)

    assert opened.disk.trouble == ""
    await opened.close()


async def test_a_disk_that_never_began_is_closed_at_once(tmp_path: Path) -> None:
    disk = OutboxDisk(tmp_path)

    assert await disk.close(0.0)
