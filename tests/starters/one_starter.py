"""One simulated starter under the running gateway without MQTT, with memory and a dispatcher."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, Literal

from gateway.app.record_log import log_failure
from gateway.errors import DamagedError, StoreError
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.line.client import LineClient, post_here
from gateway.line.line import Line
from gateway.modbus.timing import Framing, LineTiming
from gateway.records import EventRecord, RecordBus, RecordWriter
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.core.unit import SimulatedUnit
from gateway.starters.commands.dispatcher import Dispatcher
from gateway.starters.policy.policy import Policy
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.rights import Operator, Rights
from gateway.starters.policy.start_rules import PolicySettings
from gateway.starters.services.services import StarterServices
from gateway.starters.setup import StarterSetup, polls_of
from gateway.starters.telemetry.telemetry import StarterTelemetry
from tests.local_host import local_events
from tests.starters.fakes import RecordingSink
from tests.starters.router import Router
from tests.virtual_time import VirtualClock

TIMING = LineTiming(19200, Framing.parse("8N2"))


class TestMemory:
    """A document in memory; it can be damaged, and the disk can be full."""

    __test__ = False

    def __init__(self, document: Mapping[str, Any] | None = None) -> None:
        self.document = document
        self.is_damaged = False
        self.is_full = False
        self.aside: list[Mapping[str, Any] | None] = []

    def load(self) -> Mapping[str, Any] | None:
        if self.is_damaged:
            raise DamagedError("identities.json is damaged")
        return self.document

    def set_aside(self) -> None:
        self.aside.append(self.document)

    async def save(self, document: Mapping[str, Any]) -> None:
        await asyncio.sleep(0.01)
        if self.is_full:
            raise StoreError("no space left")
        self.document = document


@dataclass
class OneStarter:
    """What a test sees of it."""

    bus: SimulatedLine
    telemetry: StarterTelemetry
    dispatcher: Dispatcher
    policy: Policy
    sink: RecordingSink = field(default_factory=RecordingSink)

    @property
    def unit(self) -> Any:
        return self.bus.unit(1)

    def events(self, *codes: str) -> list[EventRecord]:
        return [event for event in self.sink.of(EventRecord) if event.code in codes]

    def requests(self) -> list[bytes]:
        """Return the PDUs of all requests that went out since the transcript was cleared."""
        return [frame.data[1:-2] for frame in self.bus.transcript if frame.sender == 0]

    def submit(self, verb: str, id_: str, **args: Any) -> None:
        self.dispatcher.submit(
            CommandRequest("pump", "alice", verb, id_, args, received_s=asyncio.get_running_loop().time())
        )

    async def replace(self, unit: SimulatedUnit) -> None:
        """Put another device in the place of the present one, and let it be identified."""
        self.bus.remove(self.unit)
        await asyncio.sleep(30.0)
        self.bus.add(unit)
        await asyncio.sleep(60.0)


@asynccontextmanager
async def one_starter(
    unit: SimulatedUnit,
    *,
    model: str | None = None,
    slot: Literal[1, 2] | None = None,
    memory: TestMemory | None = None,
    lap_s: float = 60.0,
    every_s: float = 1.0,
    family: str | None = None,
) -> AsyncIterator[OneStarter]:
    """Run it; nothing has been asked yet."""
    clock, sink = VirtualClock(asyncio.get_running_loop()), RecordingSink()
    bus = SimulatedLine(TIMING, [unit])
    variant = Variant(model=model, slot=slot)
    profile = load_profile(family or unit.family)  # as configured
    setup = StarterSetup("pump", "pumps", 1, profile, variant, every_s=every_s)
    router = Router()
    scheduler = Line(
        name="pumps",
        opener=bus.opener(),
        timing=TIMING,
        polls=polls_of(setup),
        events=local_events(router.handle),
    )
    rights = Rights([Operator("alice", ("*",), ("*",))])
    bus_of_records = RecordBus(log_failure)
    records = RecordWriter(bus_of_records, clock)
    policy = Policy(PolicySettings(), ["pump"], rights=rights, identities_memory=memory, records=records)
    telemetry = StarterTelemetry(
        setup,
        line=LineClient(scheduler, post_here),
        identities=policy.identities,
        lock_of=policy.motor_history.lock_of,
        records=records,
    )
    services = StarterServices(monitor_every_s=lap_s)
    services.add(telemetry)
    dispatcher = Dispatcher({"pump": telemetry}, rights=rights, policy=policy, records=records)
    bus_of_records.connect(policy, services, sink)
    router.add(telemetry)
    telemetry.start()
    services.start()
    task = asyncio.create_task(scheduler.run())
    yield OneStarter(bus, telemetry, dispatcher, policy, sink)
    await dispatcher.close()
    await telemetry.close()
    await services.close()
    await policy.identities.close()
    task.cancel()
    await asyncio.wait((task,))
