"""A journal in memory whose disk outlives the dispatcher, and can be slow, away or lost."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from gateway.errors import CommandError
from gateway.records import Phase, ResultRecord
from gateway.storage.journal import UNAVAILABLE, Remembered


@dataclass
class FakeDisk:
    """What is stored, in order; shared by the journals of several runs."""

    stored: dict[tuple[str, str], Remembered] = field(default_factory=dict)

    def remembered(self) -> list[Remembered]:
        return list(self.stored.values())

    def keep(self, result: ResultRecord, *, may_be_written: bool) -> None:
        key = result.client, result.id or f"stop of {result.starter}"
        if not result.id and result.phase.is_final:
            self.stored.pop(key, None)
            return
        before = self.stored.get(key)
        is_written = may_be_written or (before is not None and before.may_be_written)
        self.stored[key] = Remembered(result, may_be_written=is_written)


class FakeJournal:
    """One run's journal on a disk; once `is_dead`, nothing reaches the disk any more."""

    def __init__(self, disk: FakeDisk, *, takes_s: float = 0.0) -> None:
        self.disk = disk
        self.takes_s = takes_s
        self.trouble = ""
        self.is_failing = False
        self.is_dead = False
        self.intended: list[str] = []

    def note(self, result: ResultRecord, *, then: Callable[[], None] | None = None) -> None:
        may_be_written = result.verb == "stop" or result.phase is Phase.WRITTEN
        asyncio.get_running_loop().call_later(self.takes_s, self._land, result, may_be_written, then)

    async def intend(self, result: ResultRecord) -> None:
        await asyncio.sleep(self.takes_s)
        if self.is_failing or self.is_dead:
            raise CommandError(UNAVAILABLE, "the disk is full")
        self._land(result, True, None)
        self.intended.append(str(result.id))

    def forget(self, keys: Sequence[tuple[str, str]]) -> None:
        for key in keys:
            self.disk.stored.pop(key, None)

    def _land(self, result: ResultRecord, may_be_written: bool, then: Callable[[], None] | None) -> None:
        if self.is_dead:
            return  # the process is gone: neither stored nor published
        if (result.id or result.verb == "stop") and not self.is_failing:
            self.disk.keep(result, may_be_written=may_be_written)
        if then is not None:
            then()
