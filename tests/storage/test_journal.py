"""The commands' journal on a real file."""

from __future__ import annotations

from pathlib import Path

from gateway.records import Phase
from gateway.storage.journal import Remembered
from gateway.storage.ledger import FORGET_AT_ONCE
from tests.storage.journal_run import JournalRun, result


async def test_an_intent_is_on_the_disk_when_it_is_reported(path: Path) -> None:
    run = await JournalRun(path).begin()
    run.journal.note(result("1"))

    await run.journal.intend(result("1"))

    await run.end()
    again = await JournalRun(path).begin()
    await again.end()
    assert [remembered.may_be_written for remembered in again.recalled] == [True]


async def recalled(path: Path) -> list[Remembered]:
    run = await JournalRun(path).begin()
    await run.end()
    return run.recalled


async def test_a_stop_without_an_id_is_stored_until_it_ends(path: Path) -> None:
    run = await JournalRun(path).begin()
    await run.note(result(None, verb="stop"))
    await run.note(result(None, Phase.WRITTEN, verb="stop"))
    await run.end()  # as a crash leaves it

    again = await JournalRun(path).begin()
    (cut_short,) = again.recalled
    await again.note(result(None, Phase.UNCONFIRMED, verb="stop"))
    await again.end()

    assert (cut_short.result.id, cut_short.result.verb, cut_short.may_be_written) == (None, "stop", True)
    assert await recalled(path) == []


async def test_what_the_ledger_forgets_is_deleted_many_at_a_time(path: Path) -> None:
    run = await JournalRun(path).begin()
    ids = [str(number) for number in range(FORGET_AT_ONCE + 1)]
    for id_ in ids:
        run.journal.note(result(id_, Phase.REJECTED))

    run.journal.forget([("alice", id_) for id_ in ids[:FORGET_AT_ONCE]])
    await run.end()

    assert [each.result.id for each in await recalled(path)] == ids[FORGET_AT_ONCE:]
