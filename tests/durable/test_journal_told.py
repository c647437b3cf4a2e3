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
from tests.durable.journal_run import JournalRun, result


def fail(*_: Any, **__: Any) -> Future[Any]:
    failed: Future[Any] = Future()
    failed.set_exception(StoreError("no disk"))
    return failed


async def begin(path: Path) -> tuple[JournalRun, list[ResultRecord]]:
    """Begin a run; return it with what it wants to have told again."""
    untold: list[ResultRecord] = []
    run = JournalRun(path)
    run.journal._on_untold = untold.extend
    await run.begin()
    await run.journal.settle(5.0)
    return run, untold


async def test_a_final_result_that_nobody_acknowledged_is_wanted_told_again(path: Path) -> None:
    run, untold = await begin(path)
    assert untold == []
    for id_, phase in (("1", Phase.CONFIRMED), ("2", Phase.WRITTEN), ("3", Phase.FAILED)):
        await run.note(result(id_, phase))
    run.journal.told("alice/1")
    run.journal.told("alice/1")
    run.journal.told("alice/unknown")
    await run.end()

    again, untold = await begin(path)
    assert untold == [result("3", Phase.FAILED)]
    again.journal.told("alice/3")
    await again.end()

    third, untold = await begin(path)
    await third.end()
    assert untold == []


async def test_a_result_that_was_told_stays_so_when_its_command_is_repeated(path: Path) -> None:
    run, _ = await begin(path)
    await run.note(result("1", Phase.CONFIRMED))
    run.journal.told("alice/1")
    await run.note(result("1", Phase.CONFIRMED, is_duplicate=True))
    await run.end()

    again, untold = await begin(path)
    await again.end()
    assert untold == []


async def test_what_was_told_while_the_disk_failed_is_noted_when_it_is_back(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, _ = await begin(path)
    await run.note(result("1", Phase.CONFIRMED))
    with monkeypatch.context() as patched:
        patched.setattr(run.store, "submit", fail)
        run.journal.told("alice/1")
        await asyncio.sleep(0)
        await asyncio.sleep(0)
    run.journal.resume()
    await run.end()

    again, untold = await begin(path)
    await again.end()
    assert untold == []


async def test_what_the_disk_never_learns_of_is_bounded(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.storage.ledger.MOST_UNSAVED", 3)
    run, _ = await begin(path)
    for number in range(5):
        await run.note(result(str(number), Phase.CONFIRMED))
    with monkeypatch.context() as patched:
        patched.setattr(run.store, "submit", fail)
        for number in range(5):
            run.journal.told(f"alice/{number}")
        await asyncio.sleep(0)
        await asyncio.sleep(0)
    run.journal.resume()
    await run.end()

    again, untold = await begin(path)
    await again.end()
    assert [each.id for each in untold] == ["0", "1"]


async def test_a_disk_that_is_away_keeps_nobody_waiting(path: Path) -> None:
    path.parent.joinpath("obstacle").touch()
    run = JournalRun(path.parent / "obstacle" / "x.sqlite")
    run.store.start()
    await run.until(lambda: News.AWAY in run.news)

    await run.journal.settle(5.0)

    await run.end()


async def test_of_what_the_ledger_forgets_nothing_is_wanted_told(path: Path) -> None:
    run, _ = await begin(path)
    for number in range(FORGET_AT_ONCE):
        run.journal.note(result(str(number), Phase.CONFIRMED))
    await run.note(result("last", Phase.CONFIRMED))

    run.journal.forget([("alice", str(number)) for number in range(FORGET_AT_ONCE)])
    untold = await run_untold(run)
    await run.end()

    assert untold == {("alice", "last")}


async def run_untold(run: JournalRun) -> frozenset[tuple[str, str]]:
    return await asyncio.wrap_future(run.store.submit(LedgerTable().untold))
