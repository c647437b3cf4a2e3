"""What the ledger does when the disk is slow, absent or damaged."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import pytest

from gateway.errors import CommandError
from gateway.records import Phase
from gateway.storage.journal import UNAVAILABLE
from gateway.storage.worker import News
from tests.storage.journal_run import PATIENCE_S, JournalRun, result


def corrupt(path: Path) -> None:
    path.write_text("nonsense " * 100)


async def test_an_intent_that_takes_too_long_is_refused_and_that_is_reported(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.storage.ledger.INTEND_WITHIN_S", 0.01)
    run = await JournalRun(path).begin()
    gate = threading.Event()
    run.store.submit(lambda connection: gate.wait(PATIENCE_S))

    with pytest.raises(CommandError) as refused:
        await run.journal.intend(result("1"))

    gate.set()
    await run.end()
    assert refused.value.code == UNAVAILABLE
    assert len(run.slow) == 1


async def test_a_result_is_reported_without_the_disk_when_that_takes_too_long_and_only_once(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.storage.ledger.PUBLISH_WITHIN_S", 0.01)
    run = await JournalRun(path).begin()
    gate = threading.Event()
    run.store.submit(lambda connection: gate.wait(PATIENCE_S))
    reported: list[str] = []
    event = asyncio.Event()

    run.journal.note(result("1", Phase.CONFIRMED), then=lambda: (reported.append("reported"), event.set())[0])
    await event.wait()
    gate.set()
    await run.end()
    await asyncio.sleep(0)

    assert reported == ["reported"]


@pytest.mark.parametrize("sql", ["UPDATE ledger SET extra = '{'", "UPDATE ledger SET phase = 'dreaming'"])
async def test_a_row_that_makes_no_sense_costs_the_ledger_but_not_the_start(path: Path, sql: str) -> None:
    run = await JournalRun(path).begin()
    await run.note(result("1", Phase.CONFIRMED))
    await asyncio.wrap_future(run.store.submit(lambda connection: connection.execute(sql).fetchall()))
    await run.end()

    again = await JournalRun(path, hold_s=60.0).begin()
    await again.end()

    assert again.recalled == []
    assert News.LOST in again.news
