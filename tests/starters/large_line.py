"""Many SSW-07 on one simulated line under a dispatcher, just begun; what reaches each starter is recorded."""

from __future__ import annotations

import asyncio
from collections import defaultdict
from collections.abc import AsyncIterator, Collection
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.line.capacity.forecast import worst_stop_latency_s
from gateway.line.client import LineClient, post_here
from gateway.line.line import Line
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil
from gateway.records import Phase, RecordWriter, ResultRecord
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.core.power import MotorData
from gateway.sim.weg.ssw07 import Ssw07
from gateway.starters.commands.dispatcher import Dispatcher
from gateway.starters.policy.policy import Policy
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.rights import Operator, Rights
from gateway.starters.policy.start_rules import PolicySettings
from gateway.starters.setup import StarterSetup, polls_of
from gateway.starters.telemetry.telemetry import StarterTelemetry
from tests.local_host import local_events
from tests.starters.fakes import RUN_COIL
from tests.starters.router import Router
from tests.virtual_time import VirtualClock

START_PDU, STOP_PDU = WriteCoil(RUN_COIL, True).encode(), WriteCoil(RUN_COIL, False).encode()
MOTOR = MotorData(ramp_up_s=0.6, full_voltage_s=0.2, ramp_down_s=0.4, coast_s=0.5)
ALL = "all"  # the group of all starters
READING = (1, 3, 4)  # function codes
SLACK_S = 0.001


class TimedResults:
    """Records each command's results with the moment of their publication."""

    def __init__(self) -> None:
        self.results: dict[tuple[str | None, str], list[tuple[float, ResultRecord]]] = defaultdict(list)

    def put(self, record: object) -> None:
        if isinstance(record, ResultRecord):
            self.results[record.id, record.starter].append((asyncio.get_running_loop().time(), record))


def _times() -> dict[Any, list[float]]:
    return defaultdict(list)


@dataclass
class LargeLine:
    """The running gateway; starters are called by their addresses."""

    bus: SimulatedLine
    dispatcher: Dispatcher
    clock: VirtualClock
    sink: TimedResults
    bound_s: float  # the longest that a stop waits for its frame
    asked_s: dict[int, list[float]] = field(default_factory=_times)  # when a request reached each starter
    read_s: dict[int, list[float]] = field(default_factory=_times)  # when it was a reading
    frames_s: dict[tuple[int, bytes], list[float]] = field(default_factory=_times)  # when it was this one
    ignoring: set[int] = field(default_factory=set)  # starters that acknowledge stops and do nothing

    def unit(self, address: int) -> Any:
        return self.bus.unit(address)

    def run_locally(self, address: int) -> None:
        """Start a motor at the keypad, and go back to remote."""
        unit = self.unit(address)
        unit._set_remote(is_remote=False)
        unit.keypad_start()
        unit._set_remote(is_remote=True)

    def submit(self, verb: str, id_: str | None, address: int | str = 1, **more: Any) -> None:
        now_s = self.clock.now_s()
        fields = {"client": "alice", "received_s": now_s, **more}
        self.dispatcher.submit(CommandRequest(starter=str(address), verb=verb, id=id_, **fields))

    def frames(self, address: int, pdu: bytes = STOP_PDU) -> list[float]:
        return list(self.frames_s[address, pdu])

    def readings(self, address: int) -> list[float]:
        return list(self.read_s[address])

    def is_read_after_frame(self, address: int) -> bool:
        """Return whether a starter has been read twice since its first stop frame."""
        frames_s = self.frames(address)
        return bool(frames_s) and sum(at_s > frames_s[0] for at_s in self.readings(address)) > 1

    def results(self, id_: str, address: int | str = 1) -> list[tuple[float, ResultRecord]]:
        return self.sink.results[id_, str(address)]

    def end(self, id_: str, address: int | str = 1) -> tuple[float, ResultRecord]:
        ((at_s, final),) = [each for each in self.results(id_, address) if each[1].phase.is_final]
        return at_s, final

    def phase(self, id_: str, address: int | str = 1) -> Phase:
        return self.end(id_, address)[1].phase


class _Starter(Ssw07):
    """One that keeps what it is asked."""

    here: LargeLine

    def handle(self, pdu: bytes, now_s: float) -> bytes | None:
        self.here.asked_s[self.address].append(now_s)
        self.here.frames_s[self.address, pdu].append(now_s)
        if pdu[0] in READING:
            self.here.read_s[self.address].append(now_s)
        if pdu == STOP_PDU and self.address in self.here.ignoring:
            return pdu
        return super().handle(pdu, now_s)


@asynccontextmanager
async def large_line(
    count: int,
    *,
    every_s: float = 1.0,
    baud: int = 19200,
    watchdog_s: float | None = None,
    settings: PolicySettings | None = None,
) -> AsyncIterator[LargeLine]:
    """Run them; nothing has been asked yet."""
    clock, sink = VirtualClock(asyncio.get_running_loop()), TimedResults()
    records = RecordWriter(sink, clock)
    timing = LineTiming(baud, Framing.parse("8N2"))
    addresses = range(1, count + 1)
    units = [_Starter(address, seed=address, motor=MOTOR) for address in addresses]
    bus = SimulatedLine(timing, units, chunk_bytes=None)
    profile = load_profile("ssw07")
    setups = [
        StarterSetup(str(each), "pumps", each, profile, Variant(), every_s=every_s, watchdog_s=watchdog_s)
        for each in addresses
    ]
    polls = [poll for setup in setups for poll in polls_of(setup)]
    router = Router()
    scheduler = Line(
        name="pumps", opener=bus.opener(), timing=timing, polls=polls, events=local_events(router.handle)
    )
    line = LineClient(scheduler, post_here)
    rights = Rights([Operator("alice", ("*",), ("*",))])
    names = [setup.name for setup in setups]
    policy = Policy(
        settings or PolicySettings(groups={ALL: tuple(names)}),
        names,
        rights=rights,
        records=records,
    )
    telemetries = [StarterTelemetry(each, line=line, records=records) for each in setups]
    dispatcher = Dispatcher(
        {telemetry.setup.name: telemetry for telemetry in telemetries},
        rights=rights,
        records=records,
        policy=policy,
    )
    bound_s = worst_stop_latency_s(polls, timing) + SLACK_S
    here = LargeLine(bus, dispatcher, clock, sink, bound_s)
    for unit, telemetry in zip(units, telemetries, strict=True):
        unit.here = here
        router.add(telemetry)
        telemetry.start()
    task = asyncio.create_task(scheduler.run())
    yield here
    await dispatcher.close()
    for telemetry in telemetries:
        await telemetry.close()
    task.cancel()
    await asyncio.wait((task,))


def longest_gap_s(times_s: Collection[float], until_s: float) -> float:
    """Return the longest time between two of these, and after the last."""
    ordered = [*sorted(times_s), until_s]
    return max(b - a for a, b in pairwise(ordered))
