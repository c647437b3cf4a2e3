"""Which final results the broker may not have had, as the ledger knows it after a crash."""

from __future__ import annotations

import asyncio
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import pytest

from gateway.errors import StoreError
from gateway.records import Phase, ResultRecord
from gateway.storage.ledger import FORGET_AT_ONCE
from gateway.storage.ledger_table import LedgerTable
from gateway.storage.worker import News
from tests.storage.journal_run import JournalRun, result


def fail(*_: Any, **__: Any) -> Future[Any]:
    failed: Future[Any] = Future()
    failed.set_exception(StoreError("no disk"))
    return failed


async def begin(path: Path) -> tuple[JournalRun, list[ResultRecord]]:
    """Begin a run; return it with what it wants to have reported again."""
    undelivered: list[ResultRecord] = []
    run = JournalRun(path)
    run.journal.on_undelivered = undelivered.extend
    await run.begin()
    await run.journal.settle(5.0)
    return run, undelivered


async def test_a_final_result_that_no_one_acknowledged_is_wanted_reported_again(path: Path) -> None:
    run, undelivered = await begin(path)
    assert undelivered == []
    for id_, phase in (("1", Phase.CONFIRMED), ("2", Phase.WRITTEN), ("3", Phase.FAILED)):
        await run.note(result(id_, phase))
    run.journal.delivered("alice/1")
    run.journal.delivered("alice/1")
    run.journal.delivered("alice/unknown")
    await run.end()

    again, undelivered = await begin(path)
    assert undelivered == [result("3", Phase.FAILED)]
    again.journal.delivered("alice/3")
    await again.end()

    third, undelivered = await begin(path)
    await third.end()
    assert undelivered == []


async def test_what_was_reported_while_the_disk_failed_is_noted_when_it_is_back(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, _ = await begin(path)
    await run.note(result("1", Phase.CONFIRMED))
    with monkeypatch.context() as patched:
        patched.setattr(run.store, "submit", fail)
        run.journal.delivered("alice/1")
        await asyncio.sleep(0)
        await asyncio.sleep(0)
    run.journal.resume()
    await run.end()

    again, undelivered = await begin(path)
    await again.end()
    assert undelivered == []


async def test_what_the_disk_never_learns_of_is_bounded(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.storage.ledger.MOST_UNSAVED", 3)
    run, _ = await begin(path)
    for number in range(5):
        await run.note(result(str(number), Phase.CONFIRMED))
    with monkeypatch.context() as patched:
        patched.setattr(run.store, "submit", fail)
        for number in range(5):
            run.journal.delivered(f"alice/{number}")
        await asyncio.sleep(0)
        await asyncio.sleep(0)
    run.journal.resume()
    await run.end()

    again, undelivered = await begin(path)
    await again.end()
    assert [each.id for each in undelivered] == ["0", "1"]


async def test_a_disk_that_is_away_keeps_no_one_waiting(path: Path) -> None:
    path.parent.joinpath("obstacle").touch()
    run = JournalRun(path.parent / "obstacle" / "x.sqlite")
    run.start()
    await run.until(lambda: News.AWAY in run.news)

    await run.journal.settle(5.0)

    await run.end()


async def test_of_what_the_ledger_forgets_nothing_is_wanted_reported(path: Path) -> None:
    run, _ = await begin(path)
    for number in range(FORGET_AT_ONCE):
        run.journal.note(result(str(number), Phase.CONFIRMED))
    await run.note(result("last", Phase.CONFIRMED))

    run.journal.forget([("alice", str(number)) for number in range(FORGET_AT_ONCE)])
    undelivered = await run_untold(run)
    await run.end()

    assert undelivered == {("alice", "last")}


async def run_untold(run: JournalRun) -> frozenset[tuple[str, str]]:
    return await asyncio.wrap_future(run.store.submit(LedgerTable().undelivered))
