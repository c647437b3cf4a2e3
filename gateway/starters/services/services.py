"""What goes along with a starter's telemetry: its readiness, its keypad, and its fast words."""

from __future__ import annotations

from collections.abc import Coroutine
from dataclasses import dataclass
from functools import partial
from typing import Any

from gateway.families.diagnosis.readiness import readiness_codes
from gateway.records import AuditRecord, Record, SequenceNumbers, Sink
from gateway.starters.policy.policy import Policy
from gateway.starters.services.mapped_registers import MappedRegisters
from gateway.starters.services.parameter_monitor import EVERY_S, VERBS, ParameterMonitor, rows_set
from gateway.starters.services.readiness import ReadinessService
from gateway.starters.telemetry.telemetry import StarterTelemetry
from gateway.system.clock import Clock


@dataclass(slots=True)
class _Company:
    """The companions of one starter."""

    starter: StarterTelemetry
    watch: ReadinessService
    patrol: ParameterMonitor
    lane: MappedRegisters | None = None

    def is_about_readiness(self, record: AuditRecord) -> bool:
        """Return whether a command has set a row that says how ready the starter is, or its watchdog."""
        return not rows_set(record.verb, record.args).keys().isdisjoint(readiness_codes(self.starter.profile))

    async def close(self) -> None:
        if self.lane is not None:
            await self.lane.close()
        await self.watch.close()
        await self.patrol.close()


class StarterServices:
    """The services of all starters; subscribes to the records, to know what commands set.

    Without `may_write`, and for a starter that comes after `start`, nothing is written on our own account.
    """

    def __init__(
        self,
        precautions: Policy,
        *,
        sink: Sink,
        clock: Clock,
        sequence: SequenceNumbers,
        may_write: bool,
        patrol_every_s: float = EVERY_S,
    ) -> None:
        self._precautions = precautions
        self._sink = sink
        self._clock = clock
        self._sequence = sequence
        self._may_write = may_write
        self._patrol_every_s = patrol_every_s
        self._companies: dict[str, _Company] = {}
        self._is_started = False

    def add(self, starter: StarterTelemetry) -> None:
        """Serve this starter too."""
        watch = ReadinessService(starter)
        patrol = ParameterMonitor(starter, on_change=watch.begin, every_s=self._patrol_every_s)
        patrol.recall(starter.settings_recalled())
        watch.on_rows = patrol.note_reading
        starter.when_identified(watch.begin)
        company = self._companies[starter.setup.name] = _Company(starter, watch, patrol)
        if starter.setup.has_fast_words and starter.setup.is_enabled:
            company.lane = self._mapped_registers(starter, patrol)
        if self._is_started:
            patrol.start()

    def remove(self, starter: str) -> Coroutine[Any, Any, None]:
        """Leave a starter, whose name another may have at once; await what is returned."""
        return self._companies.pop(starter).close()

    def _mapped_registers(self, starter: StarterTelemetry, patrol: ParameterMonitor) -> MappedRegisters:
        lane = MappedRegisters(
            starter,
            wear=self._precautions.wear,
            sink=self._sink,
            clock=self._clock,
            sequence=self._sequence,
            may_write=self._may_write and not self._is_started,
            is_locked=partial(_is_locked, self._precautions, starter.setup.name),
            on_written=patrol.note_written,
        )
        starter.when_identified(lane.begin)
        starter.when_fast_words_are_lost(lane.lose)
        return lane

    def forbid_writing(self) -> None:
        """Write nothing on our own account from now on: nobody may give commands any more."""
        self._may_write = False
        for company in self._companies.values():
            if company.lane is not None:
                company.lane.forbid_writing()

    def start(self) -> None:
        """Begin; once, on the app's loop."""
        self._is_started = True
        for company in self._companies.values():
            company.patrol.start()

    async def close(self) -> None:
        """Do nothing more."""
        for name in tuple(self._companies):
            await self.remove(name)

    def put(self, record: Record) -> None:
        """Remember what a command sets."""
        if isinstance(record, AuditRecord) and record.verb in VERBS and record.starter in self._companies:
            is_over = record.decision not in ("accepted", "written")
            company = self._companies[record.starter]
            company.patrol.note_command(record.verb, record.args, is_over=is_over)
            if is_over and company.is_about_readiness(record):
                company.watch.begin()


def _is_locked(precautions: Policy, starter: str) -> bool:
    return precautions.logbook.lock_of(starter) is not None
