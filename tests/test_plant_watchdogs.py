"""Watchdogs of starters that are set through the gateway: judged, counted at once, and known to the next run."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

from gateway.config.load import parse
from gateway.config.schema import Config, LineTable
from gateway.config.setups import policy_of, rights_of, timing_of
from gateway.plant import Plant
from gateway.sim.factory import make_unit
from gateway.sim.line import SimulatedLine, SimulatedOpener
from gateway.sim.supervised import ACTION_NONE, P_ACTION, P_TIMEOUT
from gateway.starters.commander import Commander
from gateway.starters.companions import Companions
from gateway.starters.known_watchdogs import KnownWatchdogs
from gateway.starters.precautions import Precautions
from gateway.starters.records import EventRecord, Phase, ResultRecord
from gateway.starters.request import CommandRequest
from gateway.starters.sequence import Sequence as Numbers
from tests.local_host import LocalHost
from tests.plant_rig import Here
from tests.starters.fakes import RecordingSink
from tests.starters.plant import FakeMemory
from tests.starters.rig import virtually
from tests.virtual_time import VirtualClock

HEAD = (
    '[gateway]\nname = "hall"\nstate_dir = "state"\n[mqtt]\nurl = "mqtt://127.0.0.1"\n'
    '[[operator]]\nclient = "alice"\nmay = ["*"]\nstarters = ["*"]\n'
    '[[line]]\nname = "hall"\nport = "/dev/hall"\nbaud = 9600\nframing = "8E1"\n'
)


def config_of(count: int, family: str = "ssw07") -> Config:
    starters = (
        f'[[line.starter]]\nname = "pump-{at}"\naddress = {at}\nfamily = "{family}"\nevery_s = 1.0\n'
        for at in range(1, count + 1)
    )
    return parse(HEAD + "".join(starters), "hall.toml")


def hall(count: int, *, family: str = "ssw07", timeout_s: int = 0) -> SimulatedLine:
    """Return a line of starters whose watchdogs only say so."""
    line = SimulatedLine(timing_of(config_of(count, family).lines[0]))
    settings = {P_TIMEOUT: timeout_s, P_ACTION: ACTION_NONE} if family == "ssw07" else {}
    for at in range(1, count + 1):
        line.add(make_unit(family, at, seed=at, settings=settings))
    return line


@dataclass
class Run:
    """One run of the gateway's lower floors on a line that outlives it."""

    bus: SimulatedLine
    plant: Plant
    commander: Commander
    sink: RecordingSink

    def set(self, at: int, parameter: str, value: object, id_: str = "") -> None:
        args = {"parameter": parameter, "value": value}
        request = CommandRequest(f"pump-{at}", "alice", "set", id_ or f"{parameter}-{at}", args)
        self.commander.submit(request)

    def final(self, at: int, parameter: str) -> ResultRecord:
        return self.sink.final(f"{parameter}-{at}")

    def events(self, code: str) -> list[EventRecord]:
        return [event for event in self.sink.of(EventRecord) if event.code == code]

    def trips(self) -> list[str]:
        return [f"{unit.address} {trip.code}" for unit in self.bus.units for trip in unit.trips]


@asynccontextmanager
async def running(
    bus: SimulatedLine, config: Config, memory: FakeMemory | None = None, *, lap_s: float = 60.0
) -> AsyncIterator[Run]:
    """Run the plant with its commander from the opening of the port to its closing."""
    clock, sequence, sink = VirtualClock(asyncio.get_running_loop()), Numbers(), RecordingSink()
    watchdogs = KnownWatchdogs(memory=memory)
    precautions = Precautions(
        policy_of(config),
        [starter.name for starter in config.lines[0].starters],
        rights=rights_of(config),
        sink=sink,
        clock=clock,
        sequence=sequence,
        watchdogs=watchdogs,
    )

    def opener(table: LineTable) -> SimulatedOpener:
        return bus.opener(timing=timing_of(table))

    companions = Companions(sink, patrol_every_s=lap_s)
    listener: Any = Here(config=config)
    plant = Plant(
        listener,
        precautions=precautions,
        companions=companions,
        clock=clock,
        sequence=sequence,
        make_opener=opener,
    )
    host = LocalHost(plant)
    plant.build(host, config.lines)
    commander = Commander(
        plant.starters,
        rights=rights_of(config),
        sink=companions,
        clock=clock,
        sequence=sequence,
        precautions=precautions,
    )
    await plant.start()
    companions.start()
    yield Run(bus, plant, commander, sink)
    await commander.close()
    await host.stop()
    await plant.close()
    await companions.close()
    await watchdogs.close()


@virtually
async def test_sixty_starters_whose_watchdogs_are_set_through_us_are_kept_now_and_after_a_restart() -> None:
    bus, config, memory = hall(60), config_of(60), FakeMemory()
    async with running(bus, config, memory) as here:
        await asyncio.sleep(120.0)
        for at in range(1, 61):
            here.set(at, "P314", 3)
            await asyncio.sleep(1.5)
        await asyncio.sleep(45.0)

        finals = [here.final(at, "P314") for at in range(1, 61)]
        accepted = [final for final in finals if final.phase is Phase.CONFIRMED]
        refused = [final for final in finals if final.phase is Phase.REJECTED]
        assert (len(accepted), len(refused)) == (19, 41)
        assert {final.code for final in refused} == {"watchdog_unkept"}
        assert "the shortest that can be kept is" in refused[0].text
        assert here.trips() == []

    await asyncio.sleep(0.5)
    async with running(bus, config, memory) as here:
        await asyncio.sleep(60.0)

        assert here.trips() == []
        assert here.events("parameter_changed") == []
