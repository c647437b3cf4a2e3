"""What a year of starts takes of disk and memory, and how often it is written."""

from __future__ import annotations

import asyncio
import gc
import sqlite3
import tracemalloc
from pathlib import Path

import pytest

from gateway.history.readings import Readings
from gateway.storage.database import PAGE_BYTES
from gateway.storage.history import FILE, HistoryStore
from gateway.storage.worker import News
from tests.history.memory_file import MemoryFile
from tests.history.mills import Mills

STARTERS = 1
SHARE = 32  # of the 32 starters of a large site: all of it grows with their number
DAY_S = 86_400.0
STARTS_A_DAY = 20
MOST_DISK = 20 * 2**20
MOST_MEMORY = 5 * 2**20


@pytest.mark.long
async def test_a_year_of_twenty_starts_a_day_of_thirty_two_starters_stays_under_twenty_megabytes(
    tmp_path: Path,
) -> None:
    """Of all starters the last month as it is; the year before it only in its last start of each month.

    What has gone by then (curves after 20 starts, summaries after 250) leaves nothing behind in the file.
    """
    store = HistoryStore(tmp_path, on_news=_only_open)
    mills = Mills(store, STARTERS)
    await mills.begin()
    days = [float(30 * month) for month in range(12)]
    days += [360.0 + number / STARTS_A_DAY for number in range(13 * STARTS_A_DAY)]
    for day in days:
        mills.clock.at_s = day * DAY_S
        for name in mills.names:
            mills.start(name)
        await store.row("", "", "")  # the thread keeps up
    rows = await store.load([mills.names[-1]])
    assert await store.close(10.0)

    kinds = [row.kind for row in rows[mills.names[-1]]]
    assert mills.sink.starts == STARTERS * len(days)
    assert (kinds.count("start"), kinds.count("curve"), kinds.count("month")) == (250, 20, 13)
    assert SHARE * _pages(tmp_path) * PAGE_BYTES < MOST_DISK


@pytest.mark.long
async def test_thirty_two_starters_take_less_than_five_megabytes_of_memory() -> None:
    file = MemoryFile()
    spare = Mills(file, 1)  # what is made once: profiles, caches
    await spare.begin()
    spare.start(spare.names[0])
    gc.collect()
    tracemalloc.start()
    try:
        mills = Mills(_NoFile(), STARTERS)
        await mills.begin()
        before = tracemalloc.get_traced_memory()[0]
        for number in range(60):  # all that is remembered of starts is full after 50
            mills.clock.at_s = number * DAY_S / STARTS_A_DAY
            for name in mills.names:
                mills.start(name)
        await asyncio.sleep(0)  # all are published
        gc.collect()
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()

    assert mills.sink.starts == 60 * STARTERS
    assert SHARE * grown < MOST_MEMORY


async def test_a_start_is_one_transaction_and_an_idle_motor_none(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    store = HistoryStore(tmp_path, on_news=_only_open)
    mills = Mills(store, 1)
    await mills.begin()
    await store.row("", "", "")
    flushes = []
    flush = store.flush
    monkeypatch.setattr(store, "flush", lambda: (flushes.append(1), flush()))
    for number in range(20):
        mills.clock.at_s = number * 600.0
        mills.start(mills.names[0])
        await asyncio.sleep(0)

    starts = len(flushes)
    for at_s in range(20 * 600, 20 * 600 + 3600):
        mills.service.take_readings(
            mills.names[0],
            Readings(float(at_s), float(at_s), "ready", {"running": False, "accelerating": False}),
        )
    assert starts <= 20 + 4, "one each; the baseline, its curve, and what reads it"
    assert len(flushes) == starts
    monkeypatch.undo()
    assert await store.close(10.0)


class _NoFile(MemoryFile):
    """Stores nothing, so that only what the recorders hold is counted."""

    def put(self, *_: object, **__: object) -> None:
        pass


def _pages(folder: Path) -> int:
    """Return how many pages the file has, with those that are in its log only so far."""
    connection = sqlite3.connect(folder / FILE)
    try:
        return int(connection.execute("PRAGMA page_count").fetchone()[0])
    finally:
        connection.close()


def _only_open(news: News, text: str) -> None:
    assert news is News.OPEN, text
