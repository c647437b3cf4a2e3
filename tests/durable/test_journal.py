"""The commands' journal on a real file."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from gateway.clock import SystemClock
from gateway.durable.journal import MOST_EXTRA, StoredJournal
from gateway.durable.ledger_table import LedgerTable
from gateway.errors import CommandError
from gateway.starters.journal import UNAVAILABLE, Remembered
from gateway.starters.records import Phase, ResultRecord
from gateway.store import News, Store

PATIENCE_S = 10.0


def result(id_: str | None, phase: Phase = Phase.ACCEPTED, **more: Any) -> ResultRecord:
    fields = {
        "starter": "pump-1",
        "client": "alice",
        "verb": "start",
        "code": "ok",
        "text": "",
        "time_s": 5.0,
    }
    return ResultRecord(id=id_, phase=phase, **{**fields, **more})


def spoil(path: Path) -> None:
    path.write_text("nonsense " * 100)


@dataclass
class Run:
    """One run of a gateway as far as its journal goes."""

    path: Path
    hold_s: float = 0.0
    news: list[News] = field(default_factory=list)
    slow: list[str] = field(default_factory=list)
    recalled: list[Remembered] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._changed = asyncio.Event()
        table = LedgerTable()
        self.store = Store(self.path, [table], on_news=self._from_thread, retry_s=0.02)
        self.journal = StoredJournal(
            self.store,
            table,
            clock=SystemClock(),
            hold_s=self.hold_s,
            on_recalled=self._recall,
            on_slow=self.slow.append,
        )

    async def begin(self) -> Run:
        """Start, and wait until the ledger has been read."""
        self.store.start()
        await self.until(
            lambda: bool(self.recalled) or not self.journal.trouble or "lost" in self.journal.trouble
        )
        return self

    async def until(self, is_true: Callable[[], bool]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not is_true():
                self._changed.clear()
                await self._changed.wait()

    async def note(self, noted: ResultRecord) -> None:
        """Note, and wait until that is on the disk."""
        told = asyncio.Event()
        self.journal.note(noted, then=told.set)
        async with asyncio.timeout(PATIENCE_S):
            await told.wait()

    async def end(self) -> None:
        await asyncio.to_thread(self.store.close, within_s=PATIENCE_S)

    def ids(self) -> list[str | None]:
        return [remembered.result.id for remembered in self.recalled]

    def _recall(self, commands: Sequence[Remembered]) -> None:
        self.recalled = list(commands)
        self._changed.set()

    def _from_thread(self, news: News, text: str) -> None:
        self._loop.call_soon_threadsafe(self._hear, news)

    def _hear(self, news: News) -> None:
        self.news.append(news)
        if news is News.OPEN:
            self.journal.resume()
        self._changed.set()


@pytest.fixture
async def path(tmp_path: Path) -> AsyncIterator[Path]:
    yield tmp_path / "x.sqlite"
    for thread in threading.enumerate():
        assert thread.name != "store", "a store was left open"


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
    run.store.start()
    await asyncio.wrap_future(run.store.submit(lambda connection: None))
    between = run.journal.trouble
    await run.until(lambda: not run.journal.trouble)
    await run.end()

    assert before == "it is not open yet"
    assert between == "it has not been read yet"


async def test_an_intent_that_the_disk_does_not_take_is_refused(path: Path) -> None:
    path.parent.joinpath("obstacle").touch()
    run = Run(path.parent / "obstacle" / "x.sqlite")
    run.store.start()
    await run.until(lambda: News.AWAY in run.news)

    with pytest.raises(CommandError) as refused:
        await run.journal.intend(result("1"))

    await run.end()
    assert refused.value.code == UNAVAILABLE
    assert "obstacle" in run.journal.trouble


async def test_an_intent_that_takes_too_long_is_refused_and_that_is_told(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.durable.journal.INTEND_WITHIN_S", 0.01)
    run = await Run(path).begin()
    gate = threading.Event()
    run.store.submit(lambda connection: gate.wait(PATIENCE_S))

    with pytest.raises(CommandError) as refused:
        await run.journal.intend(result("1"))

    gate.set()
    await run.end()
    assert refused.value.code == UNAVAILABLE
    assert len(run.slow) == 1


async def test_a_result_is_told_without_the_disk_when_that_takes_too_long_and_only_once(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.durable.journal.TELL_WITHIN_S", 0.01)
    run = await Run(path).begin()
    gate = threading.Event()
    run.store.submit(lambda connection: gate.wait(PATIENCE_S))
    told: list[str] = []
    event = asyncio.Event()

    run.journal.note(result("1", Phase.CONFIRMED), then=lambda: (told.append("told"), event.set())[0])
    await event.wait()
    gate.set()
    await run.end()
    await asyncio.sleep(0)

    assert told == ["told"]


async def test_what_the_disk_missed_while_it_was_away_it_learns_later(path: Path) -> None:
    obstacle = path.parent / "obstacle"
    obstacle.touch()
    run = Run(obstacle / "x.sqlite")
    run.store.start()
    await run.until(lambda: News.AWAY in run.news)
    await run.note(result("1", Phase.ACCEPTED))
    await run.note(result("1", Phase.CONFIRMED))
    await run.note(result("2", Phase.CONFIRMED))
    obstacle.unlink()
    await run.until(lambda: News.OPEN in run.news)
    await run.note(result("3", Phase.CONFIRMED))
    await run.end()

    again = await Run(obstacle / "x.sqlite").begin()
    await again.end()

    assert [(r.result.id, r.result.phase) for r in again.recalled] == [
        ("1", Phase.CONFIRMED),
        ("2", Phase.CONFIRMED),
        ("3", Phase.CONFIRMED),
    ]


async def test_what_waits_for_an_absent_disk_is_bounded(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.durable.journal.MOST_UNSAVED", 2)
    obstacle = path.parent / "obstacle"
    obstacle.touch()
    run = Run(obstacle / "x.sqlite")
    run.store.start()
    await run.until(lambda: News.AWAY in run.news)
    for number in range(4):
        await run.note(result(str(number), Phase.CONFIRMED))
    obstacle.unlink()
    await run.until(lambda: News.OPEN in run.news)
    await run.note(result("last", Phase.CONFIRMED))
    await run.end()

    again = await Run(obstacle / "x.sqlite").begin()
    await again.end()

    assert again.ids() == ["2", "3", "last"]


async def test_after_the_ledger_was_lost_commands_are_held_for_a_while(path: Path) -> None:
    spoil(path)
    run = await Run(path, hold_s=60.0).begin()
    held = run.journal.trouble
    await run.end()

    again = await Run(path, hold_s=60.0).begin()
    still_held = again.journal.trouble
    await again.end()

    later = await Run(path, hold_s=0.0).begin()
    no_longer_held = later.journal.trouble
    await later.end()
    assert "it was lost" in held
    assert "it was lost" in still_held
    assert no_longer_held == ""


@pytest.mark.parametrize("sql", ["UPDATE ledger SET extra = '{'", "UPDATE ledger SET phase = 'dreaming'"])
async def test_a_row_that_makes_no_sense_costs_the_ledger_but_not_the_start(path: Path, sql: str) -> None:
    run = await Run(path).begin()
    await run.note(result("1", Phase.CONFIRMED))
    await asyncio.wrap_future(run.store.submit(lambda connection: connection.execute(sql).fetchall()))
    await run.end()

    again = await Run(path, hold_s=60.0).begin()
    await again.end()

    assert again.recalled == []
    assert News.LOST in again.news


async def test_a_row_whose_values_are_no_object_is_read_without_them(path: Path) -> None:
    run = await Run(path).begin()
    await run.note(result("1", Phase.CONFIRMED))
    sql = "UPDATE ledger SET extra = '[]'"
    await asyncio.wrap_future(run.store.submit(lambda connection: connection.execute(sql).fetchall()))
    await run.end()

    again = await Run(path).begin()
    await again.end()

    assert again.recalled[0].result.values == {}
