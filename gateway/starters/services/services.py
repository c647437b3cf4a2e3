"""What goes along with a starter's telemetry: its readiness, its keypad, and its fast words."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
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
    may_write: bool = False  # on our own account: the map of the fast words

    def is_about_readiness(self, record: AuditRecord) -> bool:
        """Return whether a command has set a row that says how ready the starter is, or its watchdog."""
        return not rows_set(record.verb, record.args).keys().isdisjoint(readiness_codes(self.starter.profile))

    async def close(self) -> None:
        if self.lane is not None:
            await self.lane.close()
        await self.watch.close()
        await self.patrol.close()


class StarterServices:
    """The companions of all starters; also the commander's sink, so that they hear what we set ourselves."""

    def __init__(self, sink: Sink, *, patrol_every_s: float = EVERY_S) -> None:
        self._sink = sink
        self._patrol_every_s = patrol_every_s
        self._companies: dict[str, _Company] = {}
        self._add_lane: Callable[[_Company], None] = lambda _: None
        self._is_started = False

    def add(self, starter: StarterTelemetry) -> None:
        """Go along with this starter; one that comes after the start is not written to on our own account."""
        patrol = ParameterMonitor(starter, on_change=lambda: watch.begin(), every_s=self._patrol_every_s)
        patrol.recall(starter.settings_recalled())
        watch = ReadinessService(starter, on_rows=patrol.note_reading)
        starter.when_identified(watch.begin)
        company = self._companies[starter.setup.name] = _Company(starter, watch, patrol)
        if self._is_started:
            self._add_lane(company)
            patrol.start()

    def remove(self, starter: str) -> Coroutine[Any, Any, None]:
        """Leave a starter, whose name another may have at once; await what is returned."""
        return self._companies.pop(starter).close()

    def add_fast_lanes(
        self,
        *,
        precautions: Policy,
        sink: Sink,
        clock: Clock,
        sequence: SequenceNumbers,
        may_write: bool,
    ) -> None:
        """Map the points of those starters for which the configuration wants it."""

        def add_lane(company: _Company) -> None:
            starter = company.starter
            if not (starter.setup.has_fast_words and starter.setup.is_enabled):
                return
            company.lane = MappedRegisters(
                starter,
                wear=precautions.wear,
                sink=sink,
                clock=clock,
                sequence=sequence,
                may_write=company.may_write,
                is_locked=partial(_is_locked, precautions, starter.setup.name),
                on_written=company.patrol.note_written,
            )
            starter.when_identified(company.lane.begin)
            starter.when_fast_words_are_lost(company.lane.lose)

        self._add_lane = add_lane
        for company in self._companies.values():
            company.may_write = may_write
            add_lane(company)

    def forbid_writing(self) -> None:
        """Write nothing on our own account from now on: nobody may give commands any more."""
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
        """Pass a record of the commander on, and remember what it sets."""
        if isinstance(record, AuditRecord) and record.verb in VERBS and record.starter in self._companies:
            is_over = record.decision not in ("accepted", "written")
            company = self._companies[record.starter]
            company.patrol.note_command(record.verb, record.args, is_over=is_over)
            if is_over and company.is_about_readiness(record):
                company.watch.begin()
        self._sink.put(record)


def _is_locked(precautions: Policy, starter: str) -> bool:
    return precautions.logbook.lock_of(starter) is not None
