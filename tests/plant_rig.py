"""A plant of four watching starters on two simulated lines, which can be reloaded; for virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from gateway.app.plant import Plant
from gateway.app.record_log import log_failure
from gateway.config.convert import policy_of, rights_of, setups_of, timing_of
from gateway.config.diff import changes_of
from gateway.config.load import parse
from gateway.config.schema import Config, LineTable
from gateway.contract import (
    AvailabilityRecord,
    Event,
    EventCode,
    RecordBus,
    RecordWriter,
    StateRecord,
    ValueRecord,
)
from gateway.plugins.history.plugin import History
from gateway.sim.bus.port import SimulatedLine, SimulatedOpener
from gateway.sim.core.unit import SimulatedUnit
from gateway.starters.policy.policy import Policy
from gateway.starters.services.services import StarterServices
from gateway.starters.setup import StarterSetup
from tests.history.support import NO_OUTBOX, NoFile
from tests.lab.torture.starters import SILENCE_TRIPS, watching_unit
from tests.local_host import LocalHost
from tests.starters.fakes import RecordingSink
from tests.virtual_time import VirtualClock

WATCHDOG_S = 6
LINE = '[[line]]\nname = "{name}"\nport = "/dev/{name}"\nbaud = 19200\nframing = "8N2"\n'
STARTER = (
    '[[line.starter]]\nname = "{name}"\naddress = {address}\nfamily = "{family}"\nevery_s = 1.0\n'
    f"watchdog_s = {WATCHDOG_S}\n"
)
HEAD = '[gateway]\nname = "plant"\nstate_dir = "state"\n[mqtt]\nurl = "mqtt://127.0.0.1"\n'


def starter(name: str, address: int, family: str) -> str:
    return STARTER.format(name=name, address=address, family=family)


HALL = LINE.format(name="hall") + starter("pump", 1, "ssw07") + starter("fan", 2, "ssw06")
YARD = LINE.format(name="yard") + starter("mill", 1, "ssw900") + starter("belt", 2, "sst")
SITE = HEAD + HALL + YARD


def site(*changes: tuple[str, str]) -> Config:
    text = SITE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return parse(text, "site.toml")


def setups(config: Config) -> list[StarterSetup]:
    return [setup for line in config.lines for setup in setups_of(line)]


@dataclass
class RunningPlant:
    """A running plant, its two buses, and what it reports to the gateway."""

    sink: RecordingSink = field(default_factory=RecordingSink)
    config: Config = field(default_factory=site)
    buses: dict[str, SimulatedLine] = field(default_factory=dict)
    requests_s: dict[str, list[float]] = field(default_factory=dict)  # requests, by "port address"
    events: list[str] = field(default_factory=list)
    forgotten: list[str] = field(default_factory=list)
    plant: Plant = field(init=False)
    services: StarterServices = field(init=False)
    history: History = field(init=False)
    records: RecordWriter = field(init=False)  # which everything shares

    # What the plant calls

    def publish_event(self, event: EventCode | Event, _case: str = "", /, **fields: Any) -> None:
        code, data = (event.code, event.data) if isinstance(event, Event) else (event, fields)
        self.events.append(f"{code} {data.get('line')}")

    def forget(self, starters: Sequence[str]) -> None:
        self.forgotten += starters

    def note_change(self) -> None:
        pass

    def note_starter(self, starter: str, trouble: str) -> None:
        pass

    def note_port(self, line: str, trouble: str) -> None:
        pass

    # The line

    def opener(self, table: LineTable) -> SimulatedOpener:
        return self.buses[table.port].opener(timing=timing_of(table))

    def unit(self, port: str, address: int) -> SimulatedUnit:
        return self.buses[f"/dev/{port}"].unit(address)

    def connect(self, port: str, address: int, family: str) -> None:
        """Add a starter that watches its line and remembers when it was asked."""
        table = next(line for line in site().lines if line.port == f"/dev/{port}")
        bus = self.buses.setdefault(table.port, SimulatedLine(timing_of(table), chunk_bytes=None))
        unit = watching_unit(family, address, WATCHDOG_S)
        requests_s = self.requests_s.setdefault(f"{port} {address}", [])
        handle = unit.handle

        def remember(pdu: bytes, now_s: float) -> bytes | None:
            requests_s.append(now_s)
            return handle(pdu, now_s)

        unit.handle = remember  # type: ignore[method-assign] # that is the point of it
        bus.add(unit)

    # What is asked of it

    async def reload(self, *changes: tuple[str, str]) -> None:
        """Go over to the site, changed."""
        config = site(*changes)
        changes_made = changes_of(self.config, config)
        ended = self.plant.apply(changes_made)
        self.history.reconfigure(setups(config), changed=changes_made.starters_gone)
        self.config = config
        await ended

    def states(self, name: str) -> list[str]:
        return [record.state for record in self.sink.of(StateRecord) if record.starter == name]

    def of_point(self, starter: str, point: str) -> list[ValueRecord]:
        """Return what was published of one point."""
        return [each for each in self.sink.of(ValueRecord) if (each.starter, each.point) == (starter, point)]

    def said(self, name: str) -> list[str]:
        """Return the availability of a starter as it was published, one after the other."""
        return [record.state for record in self.sink.of(AvailabilityRecord) if record.starter == name]

    def trips(self) -> list[str]:
        return [
            f"{unit.family} {trip.code}"
            for bus in self.buses.values()
            for unit in bus.units
            for trip in unit.trips
            if trip.code in SILENCE_TRIPS
        ]

    def writes(self) -> int:
        return sum(len(unit.writes) for bus in self.buses.values() for unit in bus.units)


@asynccontextmanager
async def running(
    settled_s: float = 30.0,
    *changes: tuple[str, str],
    more: Sequence[tuple[str, int, str]] = (),
    has_past: bool = False,
) -> AsyncIterator[RunningPlant]:
    """Run the plant; all starters are online, identified and looked through.

    `more` are units beside the four, by port, address and family: `changes` configure them. With `has_past`
    the starters are asked for what they say of their past, for the history.
    """
    here = RunningPlant(config=site(*changes))
    for port, address, family in (
        *(("hall", 1, "ssw07"), ("hall", 2, "ssw06")),
        *(("yard", 1, "ssw900"), ("yard", 2, "sst")),
        *more,
    ):
        here.connect(port, address, family)
    bus = RecordBus(log_failure)
    records = here.records = RecordWriter(bus, VirtualClock(asyncio.get_running_loop()))
    rights = rights_of(here.config)
    names = [setup.name for setup in setups(here.config)]
    policy = Policy(policy_of(here.config), names, rights=rights, records=records)
    here.history = History(
        NoFile(),  # type: ignore[arg-type] # what is asked of it
        setups(here.config),
        outbox=NO_OUTBOX,
        publish_event=here.publish_event,
        policy=policy,
        records=records,
    )
    here.history.note_left(())
    past = here.history if has_past else None
    # Seldom: it would look at the same instant as what is tested.
    services = StarterServices(monitor_every_s=3600.0, past=past)
    here.services = services
    bus.connect(policy, services, here.history, here.sink)
    plant = here.plant = Plant(
        publish_event=here.publish_event,
        forget=here.forget,
        policy=policy,
        services=services,
        make_opener=here.opener,
        on_readings=here.history.take_readings,
        language=here.config.gateway.language,
        records=records,
    )
    host = LocalHost(plant.handle)
    plant.build(host, here.config.lines, here)  # type: ignore[arg-type] # all that is asked of it
    recording = asyncio.create_task(here.history.run())
    await plant.start()
    services.start()
    await asyncio.sleep(settled_s)
    yield here
    await host.stop()
    here.history.end()
    await recording
    await plant.close()
    await services.close()
