"""Brings one starter's points onto its mapped words, where the configuration wants it; see `fast_words`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

from gateway.errors import CommandError, PortLostError
from gateway.families.command.interlock import check
from gateway.families.mapped_registers import (
    RULES,
    VERB,
    MappedBlock,
    build_map,
    fast_block,
    mapped,
    prepare_map,
    probes,
)
from gateway.families.profile.procedure import Procedure
from gateway.line.rtu.outcome import Answered, Refused
from gateway.line.scheduler.requests import Priority
from gateway.records import RecordWriter, Severity
from gateway.starters.commands.lifecycle import audit
from gateway.starters.commands.starter_io import RefusedError, Rows, StarterIo
from gateway.starters.identity.first_contact import IdentityStatus
from gateway.starters.policy.policy import GATEWAY
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.write_budget import WriteBudget
from gateway.starters.telemetry.telemetry import StarterTelemetry
from gateway.system.rate_limits import ChangeDetector
from gateway.system.supervised import SupervisedTask

RETRY_S = 10.0  # until the starter can be asked, or the motor stands
MOST_WRITINGS = 3  # of a map that does not read back as written


class MappedRegisters:
    """Maps the points of one starter, once it has proved who it is; everything on the app's loop.

    Without `may_write` only a map that stands already is used. What somebody else has changed is not written
    again as long as the gateway runs: two who write the same map would wear out its memory.
    """

    def __init__(
        self,
        starter: StarterTelemetry,
        *,
        write_budget: WriteBudget,
        records: RecordWriter,
        may_write: bool,
        is_locked: Callable[[], bool] = lambda: False,
        on_written: Callable[[Mapping[str, tuple[int, ...]]], None] = lambda _: None,
    ) -> None:
        self._starter = starter
        self._write_budget = write_budget
        self._records = records
        self._may_write = may_write
        self._is_locked = is_locked
        self._on_written = on_written
        self._starter_io = StarterIo(starter)
        self._task = SupervisedTask(f"fast words {starter.setup.name}")
        self.close = self._task.close
        self._is_contested = False
        self._news = ChangeDetector()  # the code of the last event
        self._writings = 0  # that did not read back, in a row
        self._pause_s = RETRY_S
        self._is_waiting = False  # until it is allowed to write; nothing is asked meanwhile

    def begin(self) -> None:
        """Look at the map from the beginning, because the starter has just been identified."""
        self._task.begin(self._try_on)

    def forbid_writing(self) -> None:
        """Write nothing from now on; a map that stands is still used."""
        self._may_write = False

    def lose(self, reason: str) -> None:
        """Record that the mapped words were found to be wrong, and are not read any more."""
        self._is_contested = True
        text = f"the mapped words are not used any more: {reason}; everything is read as before"
        self._publish("fast_words_changed", Severity.WARNING, text)

    async def _try_on(self) -> None:
        while True:
            if await self._attempted():
                return
            await asyncio.sleep(self._pause_s)

    async def _attempted(self) -> bool:
        """Return whether there is nothing left to try."""
        if not self._starter.is_answering:
            return True  # begun anew once it is identified again
        if self._is_waiting and self._is_forbidden(self._starter.snapshot.good_values()):
            return False
        self._pause_s, self._is_waiting = RETRY_S, False
        try:
            block = await self._planned()
            if block is None:
                self._publish("fast_words_unusable", Severity.WARNING, "there are no points to be mapped")
                return True
            return await self._use(block) if await self._stands(block) else self._is_over()
        except RefusedError as error:
            self._publish(
                "fast_words_unusable", Severity.WARNING, f"the mapped words cannot be used: {error}"
            )
            return True
        except (CommandError, PortLostError):  # the polls publish that it is silent
            return False

    async def _planned(self) -> MappedBlock | None:
        """Return what to map: only rows that this starter has, since others would read 0."""
        missing: list[str] = []
        starter = self._starter
        for probe in probes(starter.profile, starter.variant):
            try:
                await self._starter_io.read((probe,), lane=Priority.READ_BACK)
            except RefusedError:
                missing += probe.codes
        return fast_block(starter.profile, starter.variant, missing=missing)

    async def _stands(self, block: MappedBlock) -> bool:
        """Return whether the map holds what the block needs, after writing it where that is possible now."""
        rows, procedure = await self._look(block)
        if procedure.is_unchanged:
            return True
        if not self._may_write or self._is_contested:
            if not self._is_contested:
                text = "the points are not mapped; without operators, and by a reload, nothing is written"
                self._publish("fast_words_unmapped", Severity.WARNING, text)
            return False
        if self._is_forbidden(self._starter_io.values(rows)) or await self._look(block) != (rows, procedure):
            self._is_waiting = True
            return False
        wait_s = self._write_budget.take(
            self._starter.setup.name, procedure.wears, now_s=self._records.clock.now_s()
        )
        if wait_s is not None:
            self._pause_s = wait_s
            self._publish("fast_words_waiting", Severity.WARNING, self._write_budget.refusal(wait_s))
            return False
        return await self._write(block, rows, procedure)

    async def _look(self, block: MappedBlock) -> tuple[Rows, Procedure]:
        profile = self._starter.profile
        rows = await self._starter_io.read(prepare_map(profile, block).reads, lane=Priority.READ_BACK)
        return rows, build_map(profile, block, seen=rows)

    def _is_forbidden(self, points: Mapping[str, Any]) -> bool:
        """Return whether nothing may be written now: locked, the motor turns, or who answers is in doubt."""
        if self._is_locked() or self._starter.identity_standing is not IdentityStatus.MATCHING:
            return True
        return bool(check(self._starter.profile, RULES, points))

    async def _write(self, block: MappedBlock, before: Rows, procedure: Procedure) -> bool:
        """Write what differs, and return whether it reads back; nothing follows a write that failed."""
        self._writings += 1
        wanted = mapped(self._starter.profile, block)
        changed = {code: wanted[code] for code in procedure.subjects}
        self._on_written(changed)
        is_seen = False
        for step in procedure.steps:
            if not isinstance(await self._starter_io.write(step.request, lane=Priority.READ_BACK), Answered):
                break
        else:
            verify = procedure.verify
            is_seen = verify is not None and await self._starter_io.see(verify) is not None
        self._audit(before, changed, is_seen=is_seen)
        if is_seen:
            self._writings = 0
        return is_seen

    async def _use(self, block: MappedBlock) -> bool:
        """Read all by the mapped words from now on, if they are what they should be."""
        outcome = await self._starter.ask(block.request, lane=Priority.READ_BACK)
        if not isinstance(outcome, (Answered, Refused)):
            return False
        if isinstance(outcome, Refused) or block.rows_in(self._starter.profile, outcome.value) is None:
            text = "the starter does not give the mapped words; everything is read as before"
            self._publish("fast_words_unusable", Severity.WARNING, text)
            return True
        self._is_contested = False
        self._starter.use_fast_words(block)
        rows, count = len(block.rows), len(block.map)
        text = f"one request reads {rows} parameters ({count} mapped words)"
        self._publish("fast_words_used", Severity.INFO, text)
        return True

    def _is_over(self) -> bool:
        """Return whether there is no sense in trying again; said when the map takes nothing."""
        if self._writings >= MOST_WRITINGS:
            text = f"the map did not take {self._writings} writings; everything is read as before"
            self._publish("fast_words_unusable", Severity.WARNING, text)
        return self._writings >= MOST_WRITINGS or self._is_contested or not self._may_write

    def _audit(self, before: Rows, changed: Rows, *, is_seen: bool) -> None:
        args = {code: words[0] for code, words in changed.items()}
        audit(
            CommandRequest(self._starter.setup.name, GATEWAY, VERB, args=args),
            self._records,
            decision="confirmed" if is_seen else "unconfirmed",
            code="ok" if is_seen else "not_seen",
            before={code: list(before[code]) for code in changed},
            after={code: list(words) for code, words in changed.items()} if is_seen else {},
        )

    def _publish(self, code: str, severity: Severity, text: str) -> None:
        if self._news.is_new(code):
            self._starter.emitter.event(code, severity, text)
