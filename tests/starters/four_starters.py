"""A simulated line with a starter of each family, and all that the gateway has above it, in virtual time."""

from __future__ import annotations

import asyncio
import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.schema import Variant
from gateway.line.client import LocalLineClient
from gateway.line.line import Line
from gateway.line.rtu.outcome import Outcome
from gateway.modbus.adu import decode
from gateway.modbus.timing import Framing, LineTiming
from gateway.records import Phase, SequenceNumbers
from gateway.sim.bus.faults import Reply
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from gateway.starters.commands.dispatcher import Dispatcher
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.rights import Operator, Rights
from gateway.starters.setup import StarterSetup
from gateway.starters.telemetry.polling import polls_of
from gateway.starters.telemetry.telemetry import StarterTelemetry
from tests.starters.fakes import RecordingSink
from tests.virtual_time import VirtualClock

TIMING = LineTiming(19200, Framing.parse("8N2"))


@dataclass
class Site:
    """A running gateway floor and the simulated starters under it."""

    bus: SimulatedLine
    commander: Dispatcher
    telemetries: dict[str, StarterTelemetry]
    sink: RecordingSink = field(default_factory=RecordingSink)

    def unit(self, family: str) -> SimulatedUnit:
        return self.bus.unit(1 + FAMILIES.index(family))

    def submit(self, starter: str, verb: str, id_: str, **args: Any) -> None:
        self.commander.submit(
            CommandRequest(starter, "alice", verb, id_, args, received_s=asyncio.get_running_loop().time())
        )


class Router:
    """A LineListener of one line."""

    def __init__(self) -> None:
        self.starters: dict[int, StarterTelemetry] = {}

    def on_poll(self, line: str, key: str, unit: int, outcome: Outcome) -> None:
        self.starters[unit].on_poll(key, outcome)

    def on_unit(self, line: str, unit: int, is_answering: bool, reason: str, frames: tuple[str, ...]) -> None:
        self.starters[unit].on_unit(is_answering=is_answering, reason=reason, frames=frames)

    def on_port(self, line: str, is_open: bool, reason: str) -> None:
        for starter in () if is_open else self.starters.values():
            starter.on_unit(is_answering=False, reason=reason)


@asynccontextmanager
async def site() -> AsyncIterator[Site]:
    """Run four starters, one of each family, named after it; all online and identified."""
    clock, sink, sequence = VirtualClock(asyncio.get_running_loop()), RecordingSink(), SequenceNumbers()
    units = [make_unit(family, address) for address, family in enumerate(FAMILIES, 1)]
    bus = SimulatedLine(TIMING, units)
    setups = [
        StarterSetup(family, "pumps", address, load_profile(family), Variant())
        for address, family in enumerate(FAMILIES, 1)
    ]
    router = Router()
    polls = [poll for setup in setups for poll in polls_of(setup)]
    scheduler = Line(name="pumps", opener=bus.opener(), timing=TIMING, polls=polls, listener=router)
    line = LocalLineClient(scheduler)
    telemetries = {
        setup.name: StarterTelemetry(setup, line=line, sink=sink, clock=clock, sequence=sequence)
        for setup in setups
    }
    rights = Rights([Operator("alice", ("*",), ("*",))])
    commander = Dispatcher(telemetries, rights=rights, sink=sink, clock=clock, sequence=sequence)
    for telemetry in telemetries.values():
        router.starters[telemetry.setup.address] = telemetry
        telemetry.start()
    task = asyncio.create_task(scheduler.run())
    await asyncio.sleep(3.0)
    sink.clear()
    yield Site(bus, commander, telemetries, sink)
    await commander.close()
    for telemetry in telemetries.values():
        await telemetry.close()
    task.cancel()
    await asyncio.wait((task,))


async def bring_to_ready(here: Site, family: str) -> None:
    """Initialise an SST, which is not ready for a start before."""
    if family == "sst":
        here.submit("sst", "configure", "0")
        await asyncio.sleep(20.0)
        assert here.sink.final("0").phase is Phase.CONFIRMED


class LostWrites:
    """An impairment: writes act, but their answers are lost."""

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        return () if decode(reply.adu).pdu[0] in (5, 6, 15, 16) else (reply,)
