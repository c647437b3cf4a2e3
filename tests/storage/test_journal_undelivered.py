"""Which final results the broker may not have had, as the ledger knows it after a crash."""

from __future__ import annotations

from pathlib import Path

from gateway.records import Phase, ResultRecord
from tests.storage.journal_run import JournalRun, result


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
