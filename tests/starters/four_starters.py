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
from gateway.line.client import LineClient, post_here
from gateway.line.line import Line
from gateway.modbus.adu import decode
from gateway.modbus.timing import Framing, LineTiming
from gateway.records import RecordWriter
from gateway.sim.bus.faults import Reply
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from gateway.starters.commands.dispatcher import Dispatcher
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.rights import Operator, Rights
from gateway.starters.setup import StarterSetup, polls_of
from gateway.starters.telemetry.telemetry import StarterTelemetry
from tests.local_host import local_events
from tests.starters.fakes import RecordingSink
from tests.starters.router import Router
from tests.virtual_time import VirtualClock

TIMING = LineTiming(19200, Framing.parse("8N2"))


@dataclass
class Site:
    """The running gateway without MQTT, and the simulated starters under it."""

    bus: SimulatedLine
    dispatcher: Dispatcher
    telemetries: dict[str, StarterTelemetry]
    sink: RecordingSink = field(default_factory=RecordingSink)
    faults: list[str] = field(default_factory=list)  # codes of what is wrong on the line

    def unit(self, family: str) -> SimulatedUnit:
        return self.bus.unit(1 + FAMILIES.index(family))

    def submit(self, starter: str, verb: str, id_: str, **args: Any) -> None:
        self.dispatcher.submit(
            CommandRequest(starter, "alice", verb, id_, args, received_s=asyncio.get_running_loop().time())
        )


@asynccontextmanager
async def site() -> AsyncIterator[Site]:
    """Run four starters, one of each family, named after it; all online and identified."""
    clock, sink = VirtualClock(asyncio.get_running_loop()), RecordingSink()
    records = RecordWriter(sink, clock)
    units = [make_unit(family, address) for address, family in enumerate(FAMILIES, 1)]
    bus = SimulatedLine(TIMING, units)
    setups = [
        StarterSetup(family, "pumps", address, load_profile(family), Variant())
        for address, family in enumerate(FAMILIES, 1)
    ]
    faults: list[str] = []
    router = Router(faults.append)
    polls = [poll for setup in setups for poll in polls_of(setup)]
    scheduler = Line(
        name="pumps", opener=bus.opener(), timing=TIMING, polls=polls, events=local_events(router.handle)
    )
    line = LineClient(scheduler, post_here)
    telemetries = {setup.name: StarterTelemetry(setup, line=line, records=records) for setup in setups}
    rights = Rights([Operator("alice", ("*",), ("*",))])
    dispatcher = Dispatcher(telemetries, rights=rights, records=records)
    for telemetry in telemetries.values():
        router.add(telemetry)
        telemetry.start()
    task = asyncio.create_task(scheduler.run())
    await asyncio.sleep(3.0)
    sink.clear()
    yield Site(bus, dispatcher, telemetries, sink, faults)
    await dispatcher.close()
    for telemetry in telemetries.values():
        await telemetry.close()
    task.cancel()
    await asyncio.wait((task,))


class LostWrites:
    """An impairment: writes act, but their answers are lost."""

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        return () if decode(reply.adu).pdu[0] in (5, 6, 15, 16) else (reply,)
