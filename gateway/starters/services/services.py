"""The background services of each starter: readiness, the monitor of its parameters, its past."""

from __future__ import annotations

from collections.abc import Coroutine
from dataclasses import dataclass
from typing import Any

from gateway.contract import AuditRecord, EventCode, EventRecord, Record
from gateway.families import diagnosis
from gateway.starters.services.parameter_monitor import EVERY_S, VERBS, ParameterMonitor, rows_set
from gateway.starters.services.past_reader import PastListener, PastReader
from gateway.starters.services.readiness import ReadinessService
from gateway.starters.starter import StarterTelemetry


@dataclass(slots=True)
class _ServicesOfOne:
    """The services of one starter."""

    starter: StarterTelemetry
    readiness: ReadinessService
    monitor: ParameterMonitor
    past: PastReader | None = None

    def is_about_readiness(self, record: AuditRecord) -> bool:
        """Return whether a command has set a row that says how ready the starter is, or its watchdog."""
        return (
            not rows_set(record.verb, record.args)
            .keys()
            .isdisjoint(diagnosis.readiness_codes(self.starter.profile))
        )

    async def close(self) -> None:
        if self.past is not None:
            await self.past.close()
        await self.readiness.close()
        await self.monitor.close()


class StarterServices:
    """The services of all starters; subscribes to the records, to know what commands set."""

    takes = (EventRecord, AuditRecord)

    def __init__(
        self,
        *,
        monitor_every_s: float = EVERY_S,
        past: PastListener | None = None,
    ) -> None:
        self._monitor_every_s = monitor_every_s
        self._past = past  # receives what starters say of their past; None: they are not asked
        self._services: dict[str, _ServicesOfOne] = {}
        self._is_started = False

    def add(self, starter: StarterTelemetry) -> None:
        """Serve this starter too."""
        readiness = ReadinessService(starter)
        monitor = ParameterMonitor(starter, on_change=readiness.begin, every_s=self._monitor_every_s)
        monitor.recall(starter.settings_recalled())
        readiness.on_rows = monitor.note_reading
        starter.when_identified(readiness.begin)
        services = self._services[starter.setup.name] = _ServicesOfOne(starter, readiness, monitor)
        if self._past is not None:
            services.past = PastReader(starter, self._past)
            starter.when_identified(services.past.begin)
        if self._is_started:
            monitor.start()

    def remove(self, starter: str) -> Coroutine[Any, Any, None]:
        """Leave a starter, whose name another may have at once; await what is returned."""
        return self._services.pop(starter).close()

    def start(self) -> None:
        """Begin; once, on the app's loop."""
        self._is_started = True
        for services in self._services.values():
            services.monitor.start()

    async def close(self) -> None:
        """Do nothing more."""
        for name in tuple(self._services):
            await self.remove(name)

    def put(self, record: Record) -> None:
        """Remember what a command sets; ask a starter that has tripped for what it says of it."""
        if isinstance(record, EventRecord) and record.code == EventCode.FAULT:
            tripped = self._services.get(record.starter)
            if tripped is not None and tripped.past is not None:
                tripped.past.read_fault()
        if isinstance(record, AuditRecord) and record.verb in VERBS and record.starter in self._services:
            is_over = record.decision not in ("accepted", "written")
            services = self._services[record.starter]
            services.monitor.note_command(record.verb, record.args, is_over=is_over)
            if is_over and services.is_about_readiness(record):
                services.readiness.begin()
