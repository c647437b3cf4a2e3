"""The commands' journal on a real file."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from gateway.clock import SystemClock
from gateway.durable.journal import MOST_EXTRA
from gateway.starters.records import Phase, ResultRecord
from tests.durable.journal_run import PATIENCE_S, Run, result


async def test_what_was_noted_is_recalled_in_order_with_all_that_counts(path: Path) -> None:
    run = await Run(path).begin()
    await run.note(result("1", Phase.CONFIRMED, code="unchanged", text="done", values={"value": 3.5}))
    await run.note(result("2"))
    await run.end()

    again = await Run(path).begin()
    first, second = again.recalled
    await again.end()

    assert first.result == result("1", Phase.CONFIRMED, code="unchanged", text="done", values={"value": 3.5})
    assert abs(first.since_s - SystemClock().utc_s()) < PATIENCE_S
    assert (second.result.phase, second.may_be_written) == (Phase.ACCEPTED, False)


@pytest.mark.parametrize(
    ("noted", "may_be_written"),
    [
        (result("1"), False),
        (result("1", Phase.WRITTEN), True),
        (result("1", verb="stop"), True),
    ],
)
async def test_what_may_have_been_written_is_remembered(
    path: Path, noted: ResultRecord, may_be_written: bool
) -> None:
    run = await Run(path).begin()
    await run.note(noted)
    await run.end()

    again = await Run(path).begin()
    await again.end()

    assert [remembered.may_be_written for remembered in again.recalled] == [may_be_written]


async def test_an_intent_is_on_the_disk_when_it_is_told(path: Path) -> None:
    run = await Run(path).begin()
    run.journal.note(result("1"))

    await run.journal.intend(result("1"))

    await run.end()
    again = await Run(path).begin()
    await again.end()
    assert [remembered.may_be_written for remembered in again.recalled] == [True]


async def test_a_command_without_an_id_is_not_kept_but_told(path: Path) -> None:
    run = await Run(path).begin()
    told: list[str] = []

    run.journal.note(result(None), then=lambda: told.append("told"))
    run.journal.note(result(None))
    await run.journal.intend(result(None))
    await run.end()

    again = await Run(path).begin()
    await again.end()
    assert told == ["told"]
    assert again.recalled == []


async def test_what_a_result_carries_is_bounded(path: Path) -> None:
    run = await Run(path).begin()
    await run.note(result("1", Phase.CONFIRMED, values={"values": "x" * MOST_EXTRA}))
    await run.end()

    again = await Run(path).begin()
    await again.end()

    assert again.recalled[0].result.values == {}


async def test_until_the_ledger_is_read_it_counts_as_away(path: Path) -> None:
    run = Run(path)
    before = run.journal.trouble
    gate = threading.Event()
    run.store.start()
    run.store.submit(lambda connection: gate.wait(10.0))  # what is to be read waits behind it
    await run.until(lambda: run.journal.trouble != before)
    between = run.journal.trouble
    gate.set()
    await run.until(lambda: not run.journal.trouble)
    await run.end()

    assert before == "it is not open yet"
    assert between == "it has not been read yet"
