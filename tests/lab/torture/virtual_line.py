"""The gateway's layers on a simulated line in virtual time, and a judge of everything they say."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.schema import Variant
from gateway.line.capacity.forecast import forecast
from gateway.line.capacity.outage import WIDE_FACTOR, first_requests_s, gaps_of, start_order
from gateway.line.client import LineClient, post_here
from gateway.line.line import Line
from gateway.modbus.timing import Framing, LineTiming
from gateway.mqtt.contract.topics import to_level
from gateway.records import Quality, Record, RecordWriter, ResultRecord, StateRecord, ValueRecord
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.factory import make_unit
from gateway.starters.commands.dispatcher import Dispatcher
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.rights import Operator, Rights
from gateway.starters.setup import StarterSetup, polls_of
from gateway.starters.telemetry.telemetry import StarterTelemetry
from tests.lab.torture.scenario import Row
from tests.lab.torture.starters import SILENCE_TRIPS, watching_unit
from tests.lab.torture.truth import Truth
from tests.local_host import local_events
from tests.starters.router import Router
from tests.virtual_time import VirtualClock, run_virtually

TIMING = LineTiming(19200, Framing.parse("8N2"))
SETTLED_S = 3.0
MOVING = ("starting", "running", "stopping")


@dataclass
class JudgingSink:
    """A sink that keeps what is wrong, not what is said."""

    truths: dict[str, list[Truth]] = field(default_factory=dict)
    never_on: set[str] = field(default_factory=set)  # starters whose motor has not been turned on
    false: Counter[str] = field(default_factory=Counter)
    codes: Counter[str] = field(default_factory=Counter)
    finals: dict[str, list[ResultRecord]] = field(default_factory=dict)
    value_time_s: float = 0.0  # of the latest good value

    def put(self, record: Record) -> None:
        match record:
            case ValueRecord(quality=Quality.GOOD):
                self.value_time_s = record.time_s or 0.0
                point, truths = to_level(record.point), self.truths[record.starter]
                if not any(record.value in truth.values.get(point, ()) for truth in truths):
                    self.false[f"value {record.starter} {record.point} {record.value}"] += 1
            case StateRecord(quality=Quality.GOOD) if record.state in MOVING:
                if record.starter in self.never_on:
                    self.false[f"state {record.starter} {record.state}"] += 1
            case ResultRecord() if record.phase.is_final:
                self.finals.setdefault(record.id or "", []).append(record)
            case _:
                self.codes[getattr(record, "code", "")] += 1


@dataclass
class VirtualLine:
    """A running line with a starter of each family, named after it."""

    bus: SimulatedLine
    dispatcher: Dispatcher
    judge: JudgingSink
    clock: VirtualClock
    watchdog_s: int
    ids: int = 0

    @property
    def transactions(self) -> int:
        return sum(unit.handled for unit in self.bus.units)

    def command(self, starter: str, verb: str) -> str:
        self.ids += 1
        self.dispatcher.submit(
            CommandRequest(
                starter, "alice", verb, f"{verb}-{self.ids}", {}, received_s=asyncio.get_running_loop().time()
            )
        )
        return f"{verb}-{self.ids}"

    def trips(self) -> list[str]:
        """Return the watchdogs that have acted since the line was settled."""
        return [
            f"{unit.family} {trip.code}"
            for unit in self.bus.units
            for trip in unit.trips
            if trip.code in SILENCE_TRIPS and trip.at_s > SETTLED_S
        ]


@asynccontextmanager
async def virtual_line(seed: int, *, every_s: float = 1.0) -> AsyncIterator[VirtualLine]:
    """Run four starters, all online and identified; each watches its line for 1.5 times a crash's gap."""
    loop = asyncio.get_running_loop()
    clock, judge = VirtualClock(loop), JudgingSink()
    records = RecordWriter(judge, clock)
    setups = [
        StarterSetup(family, "hall", address, load_profile(family), Variant(), every_s)
        for address, family in enumerate(FAMILIES, 1)
    ]
    polls = start_order(poll for setup in setups for poll in polls_of(setup))
    watchdog_s = _watchdog_s(polls)
    units = [watching_unit(setup.name, setup.address, watchdog_s) for setup in setups]
    for setup, unit in zip(setups, units, strict=True):
        judge.truths[setup.name] = [Truth(unit, setup.name, setup.name, _twin(setup))]
    bus = SimulatedLine(TIMING, units, seed=seed)
    ear = Router(lambda code: judge.codes.update((code,)))
    scheduler = Line(
        name="hall",
        opener=bus.opener(),
        timing=TIMING,
        polls=polls,
        events=local_events(ear.handle),
        seed=seed,
        deaf_after_s=15.0,
    )
    line = LineClient(scheduler, post_here)
    telemetries = {setup.name: StarterTelemetry(setup, line=line, records=records) for setup in setups}
    rights = Rights([Operator("alice", ("*",), ("*",))])
    dispatcher = Dispatcher(telemetries, rights=rights, records=records)
    for telemetry in telemetries.values():
        ear.add(telemetry)
        telemetry.start()
    task = asyncio.create_task(scheduler.run())
    await asyncio.sleep(SETTLED_S)
    judge.never_on = set(FAMILIES)
    yield VirtualLine(bus, dispatcher, judge, clock, watchdog_s)
    await dispatcher.close()
    for telemetry in telemetries.values():
        await telemetry.close()
    task.cancel()
    await asyncio.wait((task,))


def _twin(setup: StarterSetup):  # type: ignore[no-untyped-def] # a unit
    return make_unit(setup.name, setup.address, seed=setup.address)


def _watchdog_s(polls: list) -> int:  # type: ignore[type-arg] # of Poll
    prospect = forecast(polls, TIMING)
    firsts_s = first_requests_s(polls, TIMING)
    units = range(1, len(FAMILIES) + 1)
    gaps = [gaps_of(prospect.gaps_s[unit], firsts_s[unit]).crash_s for unit in units]
    return math.ceil(WIDE_FACTOR * max(gaps))


def virtual_row(name: str, count: str, work: Callable[[Row], Coroutine[Any, Any, None]]) -> Row:
    """Return a row that `work` has filled in virtual time, with the log switched off."""
    row = Row(name, count)
    began_s = time.monotonic()
    logging.disable(logging.CRITICAL)
    try:
        run_virtually(work(row))
    finally:
        logging.disable(logging.NOTSET)
    row.took_s = time.monotonic() - began_s
    return row
