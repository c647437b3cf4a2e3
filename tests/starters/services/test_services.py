"""What goes along with a running starter: its readiness, and who turned its keypad."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

import pytest

from gateway.app.record_log import log_failure
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.schema import Variant
from gateway.line.client import LineClient, post_here
from gateway.line.line import Line
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.records import AvailabilityRecord, EventRecord, RecordBus, RecordWriter
from gateway.sim.bus.faults import Reply
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
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
from tests.starters.rig import virtually
from tests.starters.router import Router
from tests.virtual_time import VirtualClock

TIMING = LineTiming(19200, Framing.parse("8N2"))
LAP_S = 1.0  # between two blocks of the monitor


@dataclass
class Site:
    """One running starter with its services."""

    bus: SimulatedLine
    dispatcher: Dispatcher
    sink: RecordingSink

    @property
    def unit(self) -> Any:
        return self.bus.unit(1)

    def events(self, code: str) -> list[EventRecord]:
        return [event for event in self.sink.of(EventRecord) if event.code == code]


@asynccontextmanager
async def site(unit: SimulatedUnit) -> AsyncIterator[Site]:
    clock, sink = VirtualClock(asyncio.get_running_loop()), RecordingSink()
    bus_of_records = RecordBus(log_failure)
    records = RecordWriter(bus_of_records, clock)
    bus = SimulatedLine(TIMING, [unit])
    setup = StarterSetup("pump", "pumps", 1, load_profile(unit.family), Variant())
    router = Router()
    scheduler = Line(
        name="pumps",
        opener=bus.opener(),
        timing=TIMING,
        polls=polls_of(setup),
        events=local_events(router.handle),
    )
    telemetry = StarterTelemetry(setup, line=LineClient(scheduler, post_here), records=records)
    rights = Rights([Operator("alice", ("*",), ("*",))])
    policy = Policy(PolicySettings(), ["pump"], rights=rights, records=records)
    services = StarterServices(monitor_every_s=LAP_S)
    services.add(telemetry)
    router.add(telemetry)
    dispatcher = Dispatcher({"pump": telemetry}, rights=rights, policy=policy, records=records)
    bus_of_records.connect(policy, services, sink)
    telemetry.start()
    services.start()
    task = asyncio.create_task(scheduler.run())
    yield Site(bus, dispatcher, sink)
    await dispatcher.close()
    await telemetry.close()
    await services.close()
    task.cancel()
    await asyncio.wait((task,))


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_starter_says_once_after_its_identification_whether_it_is_ready(family: str) -> None:
    async with site(make_unit(family, 1)) as here:
        await asyncio.sleep(60.0)

        (event,) = here.events("readiness")
        assert set(event.data) == {"would_refuse_start", "findings", "watchdogs"}
        assert list(here.unit.writes) == []


@virtually
async def test_what_would_refuse_a_start_and_which_watchdog_acts_stands_in_the_event() -> None:
    async with site(make_unit("ssw07", 1, settings={230: 1, 314: 9, 313: 2})) as here:
        await asyncio.sleep(10.0)

        (event,) = here.events("readiness")
        assert event.severity.value == "error"
        assert "P230 = 1 (DI)" in event.text
        assert event.data["would_refuse_start"] is True
        (watchdog,) = event.data["watchdogs"]
        assert (watchdog["parameter"], watchdog["after_s"]) == ("P314", 9.0)


@virtually
async def test_a_starter_that_comes_back_as_it_was_says_nothing_new() -> None:
    async with site(make_unit("ssw07", 1)) as here:
        await asyncio.sleep(10.0)
        here.unit.power_off()
        await asyncio.sleep(30.0)
        here.unit.power_on()
        await asyncio.sleep(60.0)

        assert len(here.sink.of(AvailabilityRecord)) == 4
        assert len(here.events("readiness")) == 1


class LostReads:
    """An impairment: reads of parameters stay unanswered."""

    def apply(self, reply: Reply, dice: object) -> tuple[Reply, ...]:
        return ()


@virtually
async def test_readiness_that_could_not_be_read_is_looked_at_again() -> None:
    async with site(make_unit("ssw07", 1)) as here:
        here.bus.impair(1, LostReads(), chance=0.4)
        await asyncio.sleep(40.0)
        here.bus.heal(1)
        await asyncio.sleep(200.0)

        assert len(here.events("readiness")) == 1


@pytest.mark.parametrize(
    ("family", "register", "code"),
    [("ssw07", 314, "P314"), ("ssw06", 314, "P314"), ("ssw900", 734, "C8.2.5.3")],
)
@virtually
async def test_a_setting_that_is_changed_at_the_starter_is_an_event_and_readiness_looked_at_anew(
    family: str, register: int, code: str
) -> None:
    async with site(make_unit(family, 1)) as here:
        await asyncio.sleep(60.0)
        here.unit._write_registers(register, [70])
        await asyncio.sleep(60.0)

        (event,) = here.events("parameter_changed")
        assert event.data["parameter"] == code
        assert len(here.events("readiness")) == 2


@virtually
async def test_a_setting_that_an_operator_set_through_us_is_no_event() -> None:
    async with site(make_unit("ssw07", 1)) as here:
        await asyncio.sleep(30.0)
        args = {"parameter": "P314", "value": 30}
        here.dispatcher.submit(
            CommandRequest("pump", "alice", "set", "1", args, received_s=asyncio.get_running_loop().time())
        )
        await asyncio.sleep(60.0)

        assert here.sink.phases("1")[-1] == ("confirmed", "ok")
        assert here.events("parameter_changed") == []


@virtually
async def test_a_row_that_the_starter_refuses_is_not_asked_for_for_ever() -> None:
    vb00 = ReadHoldingRegisters(5000, 1).encode()  # which no SSW-07 has, and which distinguishes it
    unit: Any = make_unit("ssw07", 1)
    del unit.settings[277]
    async with site(unit) as here:
        await asyncio.sleep(60.0)
        here.bus.transcript.clear()
        await asyncio.sleep(60.0)

        refused = [frame for frame in here.bus.transcript if frame.sender == 1 and frame.data[1] & 0x80]
        asked = [frame for frame in here.bus.transcript if frame.sender == 0 and frame.data[1:-2] == vb00]
        assert len(refused) == len(asked)


@virtually
async def test_the_patrol_leaves_a_silent_starter_alone_and_goes_on_when_it_is_back() -> None:
    async with site(make_unit("ssw07", 1)) as here:
        await asyncio.sleep(30.0)
        here.unit.power_off()
        await asyncio.sleep(60.0)
        here.unit.settings[314] = 7
        here.unit.power_on()
        await asyncio.sleep(90.0)

        assert [event.data["parameter"] for event in here.events("parameter_changed")] == ["P314"]
