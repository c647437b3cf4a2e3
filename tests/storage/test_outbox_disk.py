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


async def test_rows_of_earlier_runs_have_numbers_up_to_0(tmp_path: Path) -> None:
    first = await Opened(tmp_path).open()
    await first.disk.recall()
    await first.disk.apply(Changes((row(1), row(2), row(3))))
    await first.disk.apply(Changes(gone=((Kind.EVENT, 2),), is_flushed=False))
    await first.close()

    second = await Opened(tmp_path).open()
    recalled = await second.disk.recall()
    await second.disk.apply(Changes((row(1),)))
    old = await second.disk.page(Kind.EVENT, after=-100, before=1, most=10)
    new = await second.disk.page(Kind.EVENT, after=0, before=100, most=10)
    await second.close()

    assert recalled.shares[Kind.EVENT].rows == 2
    assert [(each.number, each.payload) for each in old.rows] == [(-2, b"1"), (0, b"3")]
    assert [(each.number, each.payload) for each in new.rows] == [(1, b"1")]


async def test_what_had_to_be_dropped_is_reported_in_the_numbers_of_this_run(tmp_path: Path) -> None:
    first = await Opened(tmp_path, most_rows=100).open()
    await first.disk.recall()
    assert await first.disk.apply(Changes(tuple(row(number) for number in range(1, 61)))) == ()
    await first.close()

    second = await Opened(tmp_path, most_rows=100).open()
    await second.disk.recall()
    (loss,) = await second.disk.apply(Changes(tuple(row(number) for number in range(1, 61))))
    await second.close()

    assert (loss.rows, loss.upto) == (21, 21 - 60)


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
