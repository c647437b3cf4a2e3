"""A journal in memory whose disk outlives the commander, and can be slow, away or lost."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

from gateway.errors import CommandError
from gateway.starters.journal import UNAVAILABLE, Remembered
from gateway.starters.records import Phase, ResultRecord


@dataclass
class FakeDisk:
    """What is kept, in order; shared by the journals of several runs."""

    kept: dict[tuple[str, str], Remembered] = field(default_factory=dict)

    def remembered(self) -> list[Remembered]:
        return list(self.kept.values())

    def keep(self, result: ResultRecord, *, may_be_written: bool, now_s: float) -> None:
        assert result.id
        before = self.kept.get((result.client, result.id))
        self.kept[result.client, result.id] = Remembered(
            result,
            may_be_written=may_be_written or (before is not None and before.may_be_written),
            since_s=now_s if before is None else before.since_s,
        )


class FakeJournal:
    """One run's journal on a disk; once `is_dead`, nothing reaches the disk any more."""

    def __init__(self, disk: FakeDisk, *, takes_s: float = 0.0, now_s: Callable[[], float]) -> None:
        self.disk = disk
        self.takes_s = takes_s
        self.trouble = ""
        self.is_failing = False
        self.is_dead = False
        self.intended: list[str] = []
        self._now_s = now_s

    def note(self, result: ResultRecord, *, then: Callable[[], None] | None = None) -> None:
        may_be_written = result.verb == "stop" or result.phase is Phase.WRITTEN
        asyncio.get_running_loop().call_later(self.takes_s, self._land, result, may_be_written, then)

    async def intend(self, result: ResultRecord) -> None:
        await asyncio.sleep(self.takes_s)
        if self.is_failing or self.is_dead:
            raise CommandError(UNAVAILABLE, "the disk is full")
        self._land(result, True, None)
        self.intended.append(str(result.id))

    def _land(self, result: ResultRecord, may_be_written: bool, then: Callable[[], None] | None) -> None:
        if self.is_dead:
            return  # the process is gone: neither kept nor told
        if result.id and not self.is_failing:
            self.disk.keep(result, may_be_written=may_be_written, now_s=self._now_s())
        if then is not None:
            then()
