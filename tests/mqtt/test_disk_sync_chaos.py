"""The outbox and its disk under random trouble: whatever happens, what was safe is reported."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.mqtt.outbox.disk_sync import BATCH_S
from gateway.storage.spool import Kind
from tests.mqtt.spooling import InlineStore, SpoolRun, event, on_disk, result, value
from tests.virtual_time import run_virtually

LIVES = 25
STEPS = 60


@pytest.fixture(autouse=True)
def small_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.storage.outbox.Store", InlineStore)
    monkeypatch.setattr("gateway.mqtt.outbox.backlog.WINDOWS", dict.fromkeys(Kind, 8))
    monkeypatch.setattr("gateway.mqtt.outbox.backlog.MOST_AT_ONCE", 50)
    monkeypatch.setattr("gateway.mqtt.outbox.disk_sync.PAGE_ROWS", 7)


class Life:
    """Several runs on one file; `safe` is what must be reported, whatever happens."""

    def __init__(self, folder: Path, dice: random.Random, *, fails: bool) -> None:
        self.folder = folder
        self.dice = dice
        self.fails = fails
        self.runs: list[SpoolRun] = []
        self.numbers = 0
        self.safe: set[int] = set()
        self.fresh: set[int] = set()  # what the disk need not know yet
        self.reported: list[int] = []

    @property
    def run(self) -> SpoolRun:
        return self.runs[-1]

    async def begin(self) -> None:
        self.runs.append(await SpoolRun(self.folder, str(len(self.runs))).begin())

    async def step(self) -> None:
        trouble = [self.fail, self.hang] if self.fails else []
        steps: list[Callable[[], object]] = [self.put, self.put, self.link, self.repair, *trouble]
        self.dice.choice(steps)()
        await self.pass_time(self.dice.choice([0.0, 0.05, 0.5, 3.0]))
        if self.dice.random() < 0.05:
            await self.die()

    async def pass_time(self, seconds: float) -> None:
        await asyncio.sleep(seconds)
        store = self.run.store
        if seconds > 2 * BATCH_S + 1.1 and not (store.is_failing or store.is_hanging):
            self.safe |= self.fresh
            self.fresh.clear()

    def put(self) -> None:
        for _ in range(self.dice.randrange(1, 40)):
            self.numbers += 1
            make = self.dice.choice([event, result])
            self.run.put(make(self.numbers), value(self.numbers, starter=self.dice.choice("pq")))
            self.fresh.add(self.numbers)

    def link(self) -> None:
        if self.run.outbox.is_connected:
            self.run.disconnect()
        else:
            self.run.connect(window=self.dice.choice([1, 5, 100]))

    def fail(self) -> None:
        self.run.store.is_failing = True

    def hang(self) -> None:
        self.run.store.is_hanging = True

    def repair(self) -> None:
        self.run.store.is_failing = False
        if not self.run.store.is_hanging:
            return
        self.run.store.is_hanging = False
        for task in self.run.tasks:  # what hung has failed at last
            task.cancel()
        disk_sync = self.run.disk_sync
        self.run.tasks = [asyncio.create_task(work()) for work in (disk_sync.run, disk_sync.pace)]

    async def die(self) -> None:
        if self.dice.random() < 0.3 and not self.run.store.is_failing and not self.run.store.is_hanging:
            await self.run.end()
            self.safe |= self.fresh
        else:
            self.run.kill()
        self.fresh.clear()
        await self.begin()

    async def end(self) -> None:
        """Let everything be well, and wait until nothing waits any more."""
        self.repair()
        if not self.run.outbox.is_connected:
            self.run.connect(window=20)
        await asyncio.sleep(120.0)

    def texts(self, topic: str) -> list[int]:
        return [int(text) for run in self.runs for text in run.texts(topic)]


@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize("seed", range(LIVES))
def test_what_was_safe_is_reported_and_nothing_is_left(tmp_path: Path, seed: int, fails: bool) -> None:
    async def main() -> None:
        life = Life(tmp_path, random.Random(seed), fails=fails)
        await life.begin()
        for _ in range(STEPS):
            await life.step()
        await life.end()

        reported = {*life.texts("event"), *life.texts("result")}
        values = {
            *(number for run in life.runs for starter in "pq" for number in run.items(starter)),
            *(number for starter in "pq" for number in life.texts(f"{starter}/value/a")),
        }
        assert life.safe - reported == set()
        assert life.safe - values == set()
        assert all(run.lost() == {} for run in life.runs)
        assert life.run.outbox.is_idle
        assert life.run.outbox.statistics(life.run.clock.now_s())["bytes"] == 0
        assert life.run.memory_rows() == 0
        if not fails:
            for run in life.runs:
                for topic in ("event", "result"):
                    new = [int(text) for text in dict.fromkeys(run.texts(topic))]
                    assert_in_order_by_run(new)
        life.run.kill()
        assert on_disk(tmp_path) == []

    run_virtually(main())


def assert_in_order_by_run(numbers: list[int]) -> None:
    """Check that these are two rising sequences, of earlier runs and of this one, dealt into each other."""
    last = [0, 0]
    for number in numbers:
        fits = [place for place in (0, 1) if last[place] < number]
        assert fits, f"{number} came after {last}"
        last[max(fits, key=lambda place: last[place])] = number
