"""The lines with their starters as they are at present: built, changed, ended; handles their events."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable, Coroutine, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from gateway.app.health import Health
from gateway.config import ConfigChanges, LineTable, setups_of, timing_of
from gateway.contract import EventCode, ForgetRecord, PublishEvent, RecordWriter
from gateway.families import ENGLISH
from gateway.line import (
    DEAF,
    LineClient,
    LineEvent,
    LineFault,
    LineHost,
    PollResult,
    PortChanged,
    PortOpener,
    UnitChanged,
)
from gateway.starters import REFRESH_S, Policy, Readings, StarterSetup, StarterTelemetry, polls_of


class Plant:
    """All calls on the app's loop. `starters` and `lines` are by name."""

    def __init__(
        self,
        *,
        publish_event: PublishEvent,
        policy: Policy,
        serve: Callable[[StarterTelemetry], None],
        records: RecordWriter,
        refresh_s: float = REFRESH_S,
        on_readings: Callable[[str, Readings], None],
        language: str = ENGLISH,
        make_opener: Callable[[LineTable], PortOpener],
    ) -> None:
        self.starters: dict[str, StarterTelemetry] = {}
        self.lines: dict[str, LineClient] = {}
        self._by_unit: dict[tuple[str, int], StarterTelemetry] = {}
        self._publish_event = publish_event
        self._policy = policy
        self._serve = serve  # adds the services of a starter
        self._records = records
        self._make_opener = make_opener
        self._on_readings = on_readings
        self._host: LineHost
        self._health: Health
        self._edition = 0  # counts the changes
        self._refresh_s = refresh_s  # after which unchanged values are published again
        self._language = language  # of the names of faults, alarms and points

    def build(self, host: LineHost, tables: Iterable[LineTable], health: Health) -> None:
        """Make these lines in a host, with all their starters; once. `health` gets their troubles."""
        self._host, self._health = host, health
        for table in tables:
            self._add_line(table)

    async def start(self) -> None:
        """Publish what is known before the first replies are; once, on the app's loop."""
        await _start_each(self.starters.values())

    def reconfigure(self, changes: ConfigChanges) -> Coroutine[Any, Any, None]:
        """Change everything at this instant; await what is returned, which publishes it.

        What the changes do not name continues as if nothing had happened.
        """
        self._edition += 1
        endings: list[Coroutine[Any, Any, object]]
        endings = [self._retire(name).close() for name in changes.starters_gone]
        gone = ForgetRecord(lines=changes.lines_forgotten, starters=changes.starters_gone)
        self._records.put(gone)  # the broker deletes what it retains of them
        for name in changes.lines_gone:
            del self.lines[name]
            endings.append(self._host.remove_line(name))
        for name, every_s in changes.paces:
            self.starters[name].set_every(every_s)
        self._refresh_s = changes.refresh_s
        for starter in self.starters.values():
            starter.set_refresh(changes.refresh_s)
        new = [starter for table in changes.lines_joined for starter in self._join(table)]
        new += [starter for table in changes.lines_new for starter in self._add_line(table)]
        return self._start_new(new, endings)

    def end(self, reason: str) -> None:
        """Publish that no starter is watched any more, once the lines have ended; nothing is taken later."""
        for starter in self.starters.values():
            starter.end(reason)

    async def close(self) -> None:
        """End the starters with their services; the lines end with their host."""
        for starter in self.starters.values():
            await starter.close()

    def handle(self, event: LineEvent) -> None:
        """Handle what happened on a line; what comes late of a starter that is gone is ignored."""
        match event:
            case PollResult():
                starter = self._by_unit.get((event.line, event.unit))
                if starter is not None:
                    starter.on_poll(event.key, event.outcome)
            case UnitChanged():
                starter = self._by_unit.get((event.line, event.unit))
                if starter is not None:
                    starter.on_unit(is_answering=event.is_answering, reason=event.reason, frames=event.frames)
                    self._health.note_change()
            case LineFault():
                fault, frames = event.fault, list(event.frames)
                self._publish_event(
                    fault.code, fault.case, line=event.line, unit=fault.unit, frames=frames, **fault.fields
                )
            case PortChanged():
                self._change_port(event)
            case _:
                pass  # jobs and frames are the host's

    def _change_port(self, event: PortChanged) -> None:
        """Publish that a port was opened or is away: then none of its starters answers."""
        if event.is_open:
            self._publish_event(EventCode.PORT_OPEN, line=event.line)
        else:
            self._publish_event(
                EventCode.PORT_DEAF if DEAF in event.reason else EventCode.PORT_AWAY,
                line=event.line,
                reason=event.reason,
            )
            for (name, _), starter in self._by_unit.items():
                if name == event.line:
                    starter.on_unit(is_answering=False, reason=event.reason)
        self._health.note_port(event.line, "" if event.is_open else event.reason)

    def _retire(self, name: str) -> StarterTelemetry:
        starter = self.starters.pop(name)
        del self._by_unit[starter.setup.line, starter.setup.address]
        starter.retire()
        starter.line.forget(starter.setup.address)
        return starter

    def _add_line(self, table: LineTable) -> list[StarterTelemetry]:
        setups = self._setups(table)
        watchdogs = self._policy.watchdogs
        self.lines[table.name] = self._host.add_line(
            name=table.name,
            opener=self._make_opener(table),
            timing=timing_of(table),
            polls=[poll for setup in setups for poll in polls_of(setup, watchdogs.limit_s(setup))],
            allowance_s=table.adapter_allowance_s,
            seed=secrets.randbits(32),
            deaf_after_s=table.deaf_after_s,
        )
        return [self._add_starter(setup) for setup in setups]

    def _join(self, table: LineTable) -> list[StarterTelemetry]:
        """Add the starters of a table to its line, which runs; each gets its first request at once."""
        new = [self._add_starter(setup) for setup in self._setups(table)]
        for starter in new:
            polls = polls_of(starter.setup, self._policy.watchdogs.limit_s(starter.setup))
            for poll in polls:
                starter.line.add_poll(poll)
            for poll in polls[:1]:
                starter.line.expedite(poll.key)
        return new

    async def _start_new(
        self, new: Sequence[StarterTelemetry], endings: Sequence[Coroutine[Any, Any, object]]
    ) -> None:
        ended = asyncio.gather(*endings)
        await _start_each(new)
        await ended

    def _setups(self, table: LineTable) -> list[StarterSetup]:
        return [replace(setup, edition=self._edition) for setup in setups_of(table, self._language)]

    def _add_starter(self, setup: StarterSetup) -> StarterTelemetry:
        starter = StarterTelemetry(
            setup,
            line=self.lines[setup.line],
            records=self._records,
            identities=self._policy.identities,
            watchdogs=self._policy.watchdogs,
            published_faults=self._policy.published_faults,
            lock_of=self._policy.motor_history.lock_of,
            refresh_s=self._refresh_s,
        )
        self.starters[setup.name] = self._by_unit[setup.line, setup.address] = starter
        starter.on_readings = partial(self._on_readings, setup.name)
        starter.availability.on_trouble = partial(self._health.note_starter, setup.name)
        self._serve(starter)
        return starter


async def _start_each(starters: Iterable[StarterTelemetry]) -> None:
    """Start starters, which publish what is known of them, one by one: hundreds must not block the loop."""
    for starter in tuple(starters):
        starter.start()
        await asyncio.sleep(0)
