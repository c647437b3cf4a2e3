"""The history's file in its own thread."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from gateway.store import HISTORY_FILE, HistoryRow, HistoryStore, News, read_history

PATIENCE_S = 10.0


@pytest.fixture
async def history(tmp_path: Path) -> AsyncIterator[HistoryStore]:
    """A store whose file is open."""
    is_open, threads = asyncio.Event(), []

    def receive(news: News, _text: str) -> None:
        threads.append(threading.current_thread())
        is_open.set()

    store = HistoryStore(tmp_path / HISTORY_FILE)
    store.start(receive, lambda row: threads.append(threading.current_thread()))
    async with asyncio.timeout(PATIENCE_S):
        await is_open.wait()
    yield store
    assert await store.close(within_s=PATIENCE_S)
    assert set(threads) == {threading.main_thread()}


async def test_a_row_of_the_same_id_takes_the_place_of_the_one_before(history: HistoryStore) -> None:
    for id_, value in (("a", 1), ("b", 2), ("a", 3)):
        history.put(HistoryRow("p", "start", id_, {"value": value}, limit=2), is_urgent=True)
    history.copy("p", "start", "a", "chosen")
    history.copy("p", "start", "missing", "chosen")
    history.put(HistoryRow("p", "start", "c", {"value": 4}, limit=2), is_urgent=True)  # too many of its kind

    assert [(row.kind, row.id, row.data["value"]) for row in await history.rows("p", ())] == [
        ("start", "b", 2),
        ("chosen", "a", 3),
        ("start", "c", 4),
    ]


async def test_what_is_not_urgent_is_collected_into_one_transaction(
    tmp_path: Path, history: HistoryStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.store.history.COLLECT_S", 3600.0)
    for number in range(100):
        history.put(HistoryRow("p", "counters", "now", {"n": number}))
    assert read_history(tmp_path, "p") == []

    history.put(HistoryRow("p", "start", "a", {}), is_urgent=True)  # takes everything before it along

    found = [(row.kind, row.data) for row in await history.rows("p", ())]
    assert found == [("counters", {"n": 99}), ("start", {})]
