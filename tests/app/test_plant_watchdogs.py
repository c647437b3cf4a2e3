"""Watchdogs of starters that are set through the gateway: judged, counted at once, known to the next run."""

from __future__ import annotations

import asyncio
from collections import defaultdict
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

import pytest

from gateway.app.plant import Plant
from gateway.app.record_log import log_failure
from gateway.config.convert import policy_of, rights_of, setups_of, timing_of
from gateway.config.load import parse
from gateway.config.schema import Config, LineTable
from gateway.records import (
    AvailabilityRecord,
    EventRecord,
    Phase,
    Record,
    RecordBus,
    RecordWriter,
    ResultRecord,
)
from gateway.sim.bus.faults import Reply
from gateway.sim.bus.port import SimulatedLine, SimulatedOpener
from gateway.sim.factory import make_unit
from gateway.sim.ssw900.faults import C8_TIMEOUT, C8_TIMEOUT_MODE
from gateway.sim.weg.command_sources import ACTION_NONE, P_ACTION, P_TIMEOUT
from gateway.starters.commands.dispatcher import Dispatcher
from gateway.starters.policy.policy import Policy
from gateway.starters.policy.request import CommandRequest
from gateway.starters.services.services import StarterServices
from gateway.starters.telemetry.known_watchdogs import KnownWatchdogs
from tests.local_host import LocalHost
from tests.plant_rig import RunningPlant
from tests.starters.fakes import RecordingSink
from tests.starters.plant import FakeMemory
from tests.starters.rig import virtually
from tests.torture.starters import ALARM_ONLY
from tests.virtual_time import VirtualClock

READ_HOLDING = 3
HEAD = (
    '[gateway]\nname = "hall"\nstate_dir = "state"\n[mqtt]\nurl = "mqtt://127.0.0.1"\n'
    '[[operator]]\nclient = "alice"\nmay = ["*"]\nstarters = ["*"]\n'
    '[[line]]\nname = "hall"\nport = "/dev/hall"\nbaud = 9600\nframing = "8N2"\n'
)


def config_of(count: int, family: str = "ssw07") -> Config:
    starters = (
        f'[[line.starter]]\nname = "pump-{at}"\naddress = {at}\nfamily = "{family}"\nevery_s = 1.0\n'
        for at in range(1, count + 1)
    )
    return parse(HEAD + "".join(starters), "hall.toml")


def hall(count: int, *, family: str = "ssw07", timeout_s: int = 0) -> SimulatedLine:
    """Return a line of starters whose watchdogs only say so."""
    line = SimulatedLine(timing_of(config_of(count, family).lines[0]), chunk_bytes=None)
    settings = {P_TIMEOUT: timeout_s, P_ACTION: ACTION_NONE} if family == "ssw07" else {}
    if family == "ssw900":
        settings = {C8_TIMEOUT_MODE: ALARM_ONLY, C8_TIMEOUT: 200}
    for at in range(1, count + 1):
        line.add(make_unit(family, at, seed=at, settings=settings))
    return line


class WatchedSink(RecordingSink):
    """A sink that knows when something was written."""

    def __init__(self) -> None:
        super().__init__()
        self._writes: dict[str | None, asyncio.Event] = defaultdict(asyncio.Event)
        self._ends: dict[str | None, asyncio.Event] = defaultdict(asyncio.Event)

    def put(self, record: Record) -> None:
        super().put(record)
        if isinstance(record, ResultRecord) and record.phase is Phase.WRITTEN:
            self._writes[record.id].set()
        if isinstance(record, ResultRecord) and record.phase.is_final:
            self._ends[record.id].set()

    async def ended(self, id_: str) -> None:
        """Wait until a command has its final result."""
        async with asyncio.timeout(60.0):
            await self._ends[id_].wait()

    async def written(self, id_: str) -> None:
        """Wait until a command was written."""
        async with asyncio.timeout(30.0):
            await self._writes[id_].wait()


class Lost:
    """An impairment: no reply arrives."""

    def apply(self, reply: Reply, dice: object) -> tuple[Reply, ...]:
        return ()


class RefusedReads:
    """A starter refuses each read of holding registers that takes one register in."""

    def __init__(self, unit: Any, register: int, code: int = 2) -> None:
        self.is_on = True
        self._register, self._code = register, code
        self._handle, unit.handle = unit.handle, self._answer

    def _answer(self, pdu: bytes, now_s: float) -> bytes | None:
        answer: bytes | None = self._handle(pdu, now_s)
        start, count = int.from_bytes(pdu[1:3]), int.from_bytes(pdu[3:5])
        is_hit = pdu[0] == READ_HOLDING and start <= self._register < start + count
        return bytes((0x80 | READ_HOLDING, self._code)) if self.is_on and is_hit else answer


@dataclass
class Run:
    """One run of the gateway's lower layers on a line that outlives it."""

    bus: SimulatedLine
    plant: Plant
    dispatcher: Dispatcher
    sink: WatchedSink
    watchdogs: KnownWatchdogs

    def deadline_s(self, at: int) -> float | None:
        """Return the watchdog that the line keeps a starter from."""
        line: Any = self.plant.lines["hall"]
        limit_s: float = line._line._scheduler.polls.unit(at).limit_s
        return limit_s or None

    def set(self, at: int, parameter: str, value: object, id_: str = "") -> None:
        args = {"parameter": parameter, "value": value}
        now_s = asyncio.get_running_loop().time()
        request = CommandRequest(
            f"pump-{at}", "alice", "set", id_ or f"{parameter}-{at}", args, received_s=now_s
        )
        self.dispatcher.submit(request)

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
    """Run the plant with its dispatcher from the opening of the port to its closing."""
    clock, sink = VirtualClock(asyncio.get_running_loop()), WatchedSink()
    watchdogs = KnownWatchdogs(memory=memory)
    bus_of_records = RecordBus(log_failure)
    records = RecordWriter(bus_of_records, clock)
    policy = Policy(
        policy_of(config),
        [starter.name for starter in config.lines[0].starters],
        rights=rights_of(config),
        records=records,
        watchdogs=watchdogs,
    )

    def opener(table: LineTable) -> SimulatedOpener:
        return bus.opener(timing=timing_of(table))

    services = StarterServices(monitor_every_s=lap_s)
    bus_of_records.connect(policy, services, sink)
    listener: Any = RunningPlant(config=config)
    plant = Plant(
        publish_event=listener.publish_event,
        forget=listener.forget,
        policy=policy,
        services=services,
        records=records,
        make_opener=opener,
    )
    host = LocalHost(plant.handle)
    plant.build(host, config.lines, listener)
    dispatcher = Dispatcher(
        plant.starters,
        rights=rights_of(config),
        records=records,
        policy=policy,
    )
    await plant.start()
    services.start()
    yield Run(bus, plant, dispatcher, sink, watchdogs)
    await dispatcher.close()
    await host.stop()
    await plant.close()
    await services.close()
    await watchdogs.close()


@pytest.mark.long
@virtually
async def test_sixty_starters_whose_watchdogs_are_set_through_us_are_served_now_and_after_a_restart() -> None:
    bus, config, memory = hall(60), config_of(60), FakeMemory()
    async with running(bus, config, memory) as here:
        await asyncio.sleep(60.0)
        for at in range(1, 61):
            here.set(at, "P314", 3)
            await here.sink.ended(f"P314-{at}")
        await asyncio.sleep(45.0)

        finals = [here.final(at, "P314") for at in range(1, 61)]
        accepted = [final for final in finals if final.phase is Phase.CONFIRMED]
        refused = [final for final in finals if final.phase is Phase.REJECTED]
        assert (len(accepted), len(refused)) == (19, 41)
        assert {final.code for final in refused} == {"watchdog_unkept"}
        assert "the shortest that can be met is" in refused[0].text
        assert here.trips() == []

    await asyncio.sleep(0.5)
    async with running(bus, config, memory) as here:
        await asyncio.sleep(60.0)

        assert here.trips() == []
        assert here.events("parameter_changed") == []


@pytest.mark.parametrize(
    ("family", "parameter", "value", "limit_s"),
    [
        ("ssw07", "P314", 3, 3.0),
        ("ssw06", "P314", 4, 4.0),
        ("ssw900", "C8.2.5.3", 5, 5.0),
        ("sst", "R41", 6, 6.0),
    ],
)
@virtually
async def test_a_watchdog_counts_from_its_write_on_and_from_the_first_poll_of_the_next_run(
    family: str, parameter: str, value: int, limit_s: float
) -> None:
    bus, config, memory = hall(2, family=family), config_of(2, family), FakeMemory()
    async with running(bus, config, memory) as here:
        await asyncio.sleep(30.0)
        here.set(1, parameter, value)
        await here.sink.written(f"{parameter}-1")

        assert here.deadline_s(1) == limit_s
        await asyncio.sleep(20.0)
        assert here.final(1, parameter).phase is Phase.CONFIRMED
        assert here.deadline_s(1) == limit_s
    async with running(bus, config, memory) as here:
        assert here.deadline_s(1) == limit_s
        assert here.deadline_s(2) != limit_s


@virtually
async def test_a_watchdog_that_is_made_longer_counts_only_once_it_reads_back() -> None:
    bus, config = hall(1, timeout_s=5), config_of(1)
    async with running(bus, config) as here:
        await asyncio.sleep(20.0)
        bus.impair(1, Lost(), chance=1.0)
        here.set(1, "P314", 60)
        await asyncio.sleep(0.2)
        assert here.deadline_s(1) == 5.0

        bus.heal(1)
        await asyncio.sleep(200.0)
        assert here.deadline_s(1) == float(bus.unit(1).settings[P_TIMEOUT])


@virtually
async def test_a_write_that_was_not_seen_to_act_counts_until_the_row_is_read_again() -> None:
    bus, config = hall(1, timeout_s=30), config_of(1)
    bus.unit(1).is_command_refused = False
    async with running(bus, config) as here:
        await asyncio.sleep(20.0)
        write = bus.unit(1)._write_registers
        bus.unit(1)._write_registers = lambda *_: write(P_TIMEOUT, [30])
        here.set(1, "P314", 4)
        await asyncio.sleep(1.0)
        assert here.deadline_s(1) == 4.0

        await asyncio.sleep(30.0)
        assert here.final(1, "P314").phase is Phase.UNCONFIRMED
        assert here.deadline_s(1) == 30.0


@virtually
async def test_a_set_that_would_cost_another_starter_its_watchdog_is_refused() -> None:
    bus, config = hall(30, timeout_s=4), config_of(30)
    async with running(bus, config) as here:
        await asyncio.sleep(90.0)
        here.set(1, "P314", 1)
        here.set(2, "P314", 60)
        await asyncio.sleep(5.0)

        assert here.final(1, "P314").code == "watchdog_unkept"
        assert here.final(2, "P314").phase is Phase.CONFIRMED
        assert here.trips() == []


@virtually
async def test_two_sets_at_once_are_judged_together() -> None:
    bus, config = hall(60), config_of(60)
    for at in range(1, 19):
        bus.unit(at).settings[P_TIMEOUT] = 3
    async with running(bus, config) as here:
        await asyncio.sleep(60.0)
        for at in (19, 20):
            here.set(at, "P314", 3)
        for at in (19, 20):
            await here.sink.ended(f"P314-{at}")

        finals = [here.final(at, "P314") for at in (19, 20)]
        assert sum(final.phase is Phase.CONFIRMED for final in finals) <= 1


@pytest.mark.parametrize("parameter", [P_ACTION, P_TIMEOUT])
@virtually
async def test_a_watchdog_changed_at_the_keypad_before_the_first_patrol_is_noticed(parameter: int) -> None:
    bus, config = hall(1), config_of(1)
    async with running(bus, config) as here:
        await asyncio.sleep(15.0)
        bus.unit(1).settings[parameter] = 2
        await asyncio.sleep(600.0)

        (event,) = here.events("parameter_changed")
        assert event.data["parameter"] == f"P{parameter}"


@virtually
async def test_a_watchdog_changed_at_the_keypad_while_the_gateway_was_away_is_noticed_and_stored() -> None:
    bus, config, memory = hall(1, timeout_s=30), config_of(1), FakeMemory()
    async with running(bus, config, memory) as here:
        await asyncio.sleep(15.0)
    bus.unit(1).settings[P_TIMEOUT] = 7
    async with running(bus, config, memory) as here:
        await asyncio.sleep(15.0)

        (event,) = here.events("parameter_changed")
        assert (event.data["before"]["value"], event.data["after"]["value"]) == (30, 7)
        assert here.deadline_s(1) == 7.0


@virtually
async def test_a_watchdog_row_that_is_refused_keeps_its_last_value_and_is_asked_for_within_minutes() -> None:
    bus, config, memory = hall(1, timeout_s=6), config_of(1), FakeMemory()
    async with running(bus, config, memory) as here:
        await asyncio.sleep(15.0)
    refusal = RefusedReads(bus.unit(1), P_TIMEOUT)
    async with running(bus, config, memory) as here:
        await asyncio.sleep(15.0)
        assert here.deadline_s(1) == 6.0
        (event,) = here.events("degraded")
        assert "P314 is refused" in event.text

        bus.unit(1).settings[P_TIMEOUT] = 8
        refusal.is_on = False
        await asyncio.sleep(125.0)
        assert here.deadline_s(1) == 8.0
        assert len(here.events("recovered")) == 1
        assert [r.state for r in here.sink.of(AvailabilityRecord)][-2:] == ["degraded", "online"]


@virtually
async def test_a_damaged_file_of_watchdogs_is_set_aside_and_said() -> None:
    bus, config = hall(1), config_of(1)
    for document in ({"starters": 7}, {"starters": {"pump-1": {"rows": {"P314": [70_000]}, "written": {}}}}):
        memory = FakeMemory(document)
        async with running(bus, config, memory) as here:
            assert here.deadline_s(1) is None
            assert memory.set_asides == 1
            assert len(here.events("memory_damaged")) == 1


@virtually
async def test_known_watchdogs_speak_against_a_line_that_would_miss_them() -> None:
    bus, config, memory = hall(3, timeout_s=2), config_of(3), FakeMemory()
    async with running(bus, config, memory) as here:
        await asyncio.sleep(15.0)
        watchdogs = here.watchdogs

        assert await watchdogs.missed_on(setups_of(config.lines[0])) == {}
        missed = await watchdogs.missed_on(setups_of(config_of(60).lines[0]))
        assert set(missed) <= {"pump-1", "pump-2", "pump-3"}
