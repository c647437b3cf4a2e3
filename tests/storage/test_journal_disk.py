"""What the ledger does when the disk is slow, absent or damaged."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import pytest

from gateway.errors import CommandError
from gateway.records import Phase
from gateway.storage.journal import UNAVAILABLE
from gateway.storage.ledger import SAVE_AT_ONCE
from gateway.storage.worker import News
from tests.storage.journal_run import PATIENCE_S, JournalRun, result


def corrupt(path: Path) -> None:
    path.write_text("nonsense " * 100)


async def test_an_intent_that_the_disk_does_not_take_is_refused(path: Path) -> None:
    path.parent.joinpath("obstacle").touch()
    run = JournalRun(path.parent / "obstacle" / "x.sqlite")
    run.start()
    await run.until(lambda: News.AWAY in run.news)

    with pytest.raises(CommandError) as refused:
        await run.journal.intend(result("1"))

    await run.end()
    assert refused.value.code == UNAVAILABLE
    assert "obstacle" in run.journal.trouble


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


async def test_what_the_disk_missed_while_it_was_away_it_learns_later(path: Path) -> None:
    obstacle = path.parent / "obstacle"
    obstacle.touch()
    run = JournalRun(obstacle / "x.sqlite")
    run.start()
    await run.until(lambda: News.AWAY in run.news)
    await run.note(result("1", Phase.ACCEPTED))
    await run.note(result("1", Phase.CONFIRMED))
    await run.note(result("2", Phase.CONFIRMED))
    obstacle.unlink()
    await run.until(lambda: News.OPEN in run.news)
    await run.note(result("3", Phase.CONFIRMED))
    await run.end()

    again = await JournalRun(obstacle / "x.sqlite").begin()
    await again.end()

    assert [(r.result.id, r.result.phase) for r in again.recalled] == [
        ("1", Phase.CONFIRMED),
        ("2", Phase.CONFIRMED),
        ("3", Phase.CONFIRMED),
    ]


async def test_what_waits_for_an_absent_disk_is_bounded(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.storage.ledger.MOST_UNSAVED", 2)
    obstacle = path.parent / "obstacle"
    obstacle.touch()
    run = JournalRun(obstacle / "x.sqlite")
    run.start()
    await run.until(lambda: News.AWAY in run.news)
    for number in range(4):
        await run.note(result(str(number), Phase.CONFIRMED))
    obstacle.unlink()
    await run.until(lambda: News.OPEN in run.news)
    await run.note(result("last", Phase.CONFIRMED))
    await run.end()

    again = await JournalRun(obstacle / "x.sqlite").begin()
    await again.end()

    assert again.ids() == ["2", "3", "last"]


async def test_after_the_ledger_was_lost_commands_are_held_for_a_while(path: Path) -> None:
    corrupt(path)
    run = await JournalRun(path, hold_s=60.0).begin()
    held = run.journal.trouble
    await run.end()

    again = await JournalRun(path, hold_s=60.0).begin()
    still_held = again.journal.trouble
    await again.end()

    later = await JournalRun(path, hold_s=0.0).begin()
    no_longer_held = later.journal.trouble
    await later.end()
    assert "it was lost" in held
    assert "it was lost" in still_held
    assert no_longer_held == ""


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


async def test_a_row_whose_values_are_no_object_is_read_without_them(path: Path) -> None:
    run = await JournalRun(path).begin()
    await run.note(result("1", Phase.CONFIRMED))
    sql = "UPDATE ledger SET extra = '[]'"
    await asyncio.wrap_future(run.store.submit(lambda connection: connection.execute(sql).fetchall()))
    await run.end()

    again = await JournalRun(path).begin()
    await again.end()

    assert again.recalled[0].result.values == {}


async def test_thousands_of_results_that_the_disk_missed_are_not_submitted_at_one_go(path: Path) -> None:
    obstacle = path.parent / "obstacle"
    obstacle.touch()
    run = JournalRun(obstacle / "x.sqlite")
    run.start()
    await run.until(lambda: News.AWAY in run.news)
    for number in range(1000):
        run.journal.note(result(f"{number}", Phase.CONFIRMED, verb="stop"))
    await run.note(result("last", Phase.CONFIRMED))
    submit, pieces = run.store.submit, list[object]()
    run.store.submit = lambda *args, **kwargs: (pieces.append(args), submit(*args, **kwargs))[1]  # type: ignore[method-assign]

    run.journal.resume()
    at_once = len(pieces)
    obstacle.unlink()
    await run.until(lambda: News.OPEN in run.news)
    async with asyncio.timeout(PATIENCE_S):
        while run.journal._unsaved:
            await run.journal.settle(PATIENCE_S)
    await run.journal.settle(PATIENCE_S)
    await run.end()

    assert at_once <= 2 * SAVE_AT_ONCE
    again = await JournalRun(obstacle / "x.sqlite").begin()
    await again.end()
    assert {each.result.id for each in again.recalled} == {*map(str, range(1000)), "last"}
