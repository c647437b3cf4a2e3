"""A dispatcher with a journal that can be slow, away, or outlive a crash."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from gateway.starters.commands.dispatcher import Dispatcher
from gateway.starters.policy.rights import Operator, Rights
from tests.starters.fake_journal import FakeDisk, FakeJournal
from tests.starters.fakes import TRANSACTION_S
from tests.starters.rig import CommandRig

RIGHTS = Rights([Operator("alice", ("*",), ("*",)), Operator("victor", ("stop",), ("*",))])


@dataclass
class JournalRig(CommandRig):
    """A dispatcher with a journal; `crash` ends it as a power cut would, `restart` begins another one."""

    disk: FakeDisk = field(default_factory=FakeDisk)
    takes_s: float = 0.002

    def __post_init__(self) -> None:
        super().__post_init__()
        self.begin_run()

    def begin_run(self) -> None:
        self.journal = FakeJournal(self.disk, takes_s=self.takes_s)
        self.dispatcher = Dispatcher(
            {self.setup.name: self.telemetry},
            rights=RIGHTS,
            records=self.records,
            journal=self.journal,
        )

    async def until_written(self) -> None:
        while not self.line.writes:  # noqa: ASYNC110 - virtual time
            await asyncio.sleep(TRANSACTION_S / 4)

    def crash(self) -> None:
        """Nothing of this run goes on: no write, no record, no result."""
        self.journal.is_dead = True
        for task in list(self.dispatcher._tasks):
            task.cancel()

    def restart(self) -> None:
        self.sink.clear()
        self.begin_run()
        self.dispatcher.recall(self.disk.remembered())


async def rig_online(**options: object) -> JournalRig:
    rig = JournalRig(**options)  # type: ignore[arg-type]  # the fields of the rig
    await rig.online()
    return rig
