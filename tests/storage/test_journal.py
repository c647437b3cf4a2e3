"""The commands' journal on a real file."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from gateway.records import Phase
from gateway.storage.journal import Remembered
from gateway.storage.ledger import FORGET_AT_ONCE, MOST_EXTRA
from tests.storage.journal_run import JournalRun, result


async def test_what_was_noted_is_recalled_in_order_with_all_that_counts(path: Path) -> None:
    run = await JournalRun(path).begin()
    await run.note(result("1", Phase.CONFIRMED, code="unchanged", text="done", values={"value": 3.5}))
    await run.note(result("2"))
    await run.end()

    again = await JournalRun(path).begin()
    first, second = again.recalled
    await again.end()

    assert first.result == result("1", Phase.CONFIRMED, code="unchanged", text="done", values={"value": 3.5})
    assert (second.result.phase, second.may_be_written) == (Phase.ACCEPTED, False)


async def test_an_intent_is_on_the_disk_when_it_is_reported(path: Path) -> None:
    run = await JournalRun(path).begin()
    run.journal.note(result("1"))

    await run.journal.intend(result("1"))

    await run.end()
    again = await JournalRun(path).begin()
    await again.end()
    assert [remembered.may_be_written for remembered in again.recalled] == [True]


async def test_what_a_result_carries_is_bounded(path: Path) -> None:
    run = await JournalRun(path).begin()
    await run.note(result("1", Phase.CONFIRMED, values={"values": "x" * MOST_EXTRA}))
    await run.end()

    again = await JournalRun(path).begin()
    await again.end()

    assert again.recalled[0].result.values == {}


async def test_until_the_ledger_is_read_it_counts_as_away(path: Path) -> None:
    run = JournalRun(path)
    before = run.journal.trouble
    gate = threading.Event()
    run.start()
    run.store.submit(lambda connection: gate.wait(10.0))  # what is to be read waits behind it
    await run.until(lambda: run.journal.trouble != before)
    between = run.journal.trouble
    gate.set()
    await run.until(lambda: not run.journal.trouble)
    await run.end()

    assert before == "it is not open yet"
    assert between == "it has not been read yet"


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


async def test_a_stop_without_an_id_that_comes_before_the_ledger_is_read_is_none_of_an_earlier_run(
    path: Path,
) -> None:
    run = JournalRun(path)
    run.start()
    run.journal.note(result(None, verb="stop"))
    await run.until(lambda: not run.journal.trouble)
    await run.end()

    assert run.recalled == []
    assert [each.result.id for each in await recalled(path)] == [None]


async def test_what_the_ledger_forgets_is_deleted_many_at_a_time(path: Path) -> None:
    run = await JournalRun(path).begin()
    ids = [str(number) for number in range(FORGET_AT_ONCE + 1)]
    for id_ in ids:
        run.journal.note(result(id_, Phase.REJECTED))

    run.journal.forget([("alice", id_) for id_ in ids[:FORGET_AT_ONCE]])
    await run.end()

    assert [each.result.id for each in await recalled(path)] == ids[FORGET_AT_ONCE:]


async def test_an_id_that_is_used_again_after_it_was_forgotten_stays(path: Path) -> None:
    run = await JournalRun(path).begin()
    await run.note(result("1", Phase.REJECTED))
    run.journal.forget([("alice", "1")])
    await run.note(result("1", Phase.WRITTEN))
    run.journal.forget([("alice", str(number)) for number in range(2, FORGET_AT_ONCE + 2)])
    await run.end()

    assert [each.result.phase for each in await recalled(path)] == [Phase.WRITTEN]


async def test_a_row_that_cannot_be_stored_for_an_error_of_our_own_is_not_tried_again_and_again(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run = await JournalRun(path).begin()

    await run.note(result("1", text="\ud800"))
    for number in range(2, 6):
        await run.note(result(str(number)))
    await run.end()

    assert len([each for each in caplog.records if "a piece of work failed" in each.message]) == 1
    assert [each.result.id for each in await recalled(path)] == ["2", "3", "4", "5"]
