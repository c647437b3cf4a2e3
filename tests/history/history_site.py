"""One simulated starter on a line with its telemetry, its services and its history, in virtual time."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from gateway.app.history import HistoryService
from gateway.app.record_log import log_failure
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.line.client import LineClient, post_here
from gateway.line.line import Line
from gateway.modbus.timing import Framing, LineTiming
from gateway.records import EventRecord, RecordBus, RecordWriter, TripRecord, ValueRecord
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.core.unit import SimulatedUnit
from gateway.starters.policy.policy import Policy
from gateway.starters.policy.rights import Operator, Rights
from gateway.starters.policy.start_rules import PolicySettings, RuleSet
from gateway.starters.services.services import StarterServices
from gateway.starters.setup import StarterSetup, polls_of
from gateway.starters.telemetry.telemetry import StarterTelemetry
from gateway.storage.history_table import HistoryRow
from tests.history.memory_file import MemoryFile
from tests.local_host import local_events
from tests.starters.fakes import RecordingSink
from tests.starters.router import Router
from tests.virtual_time import VirtualClock, run_virtually

TIMING = LineTiming(19200, Framing.parse("8N2"))


def virtually(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Let an async test run to its end in virtual time."""

    @functools.wraps(test)
    def run(*args: Any, **kwargs: Any) -> None:
        run_virtually(test(*args, **kwargs))

    return run


@dataclass
class MotorSite:
    """One running starter with its history."""

    bus: SimulatedLine
    clock: VirtualClock
    sink: RecordingSink
    history: HistoryService
    file: MemoryFile

    @property
    def unit(self) -> Any:
        return self.bus.unit(1)

    def start(self) -> None:
        """Start the motor as somebody at the starter does."""
        self.unit.advance(self.clock.now_s())
        self.unit.motor.start()

    def stop(self) -> None:
        self.unit.advance(self.clock.now_s())
        self.unit.motor.stop()

    def trips(self) -> list[dict[str, Any]]:
        return [dict(record.data) for record in self.sink.of(TripRecord)]

    def events(self, code: str) -> list[EventRecord]:
        return [event for event in self.sink.of(EventRecord) if event.code == code]

    def value(self, point: str) -> ValueRecord:
        return self.sink.values(point)[-1]

    def rows(self, kind: str) -> list[HistoryRow]:
        """What of a kind the disk was given last."""
        return [row for row in self.file.rows.values() if row.kind == kind]


@asynccontextmanager
async def site(
    unit: SimulatedUnit,
    state_dir: Path,
    *,
    rules: RuleSet | None = None,
    rows: Sequence[HistoryRow] = (),
    every_s: float = 1.0,
    boot: str = "boot-1",
) -> AsyncIterator[MotorSite]:
    """`rows` are what earlier runs have stored."""
    clock, sink = VirtualClock(asyncio.get_running_loop()), RecordingSink()
    bus_of_records, router = RecordBus(log_failure), Router()
    records = RecordWriter(bus_of_records, clock)
    bus = SimulatedLine(TIMING, [unit], chunk_bytes=None)
    setup = StarterSetup("pump", "pumps", 1, load_profile(unit.family), Variant(), every_s=every_s)
    line = Line(
        name="pumps",
        opener=bus.opener(),
        timing=TIMING,
        polls=polls_of(setup),
        events=local_events(router.handle),
    )
    telemetry = StarterTelemetry(setup, line=LineClient(line, post_here), records=records)
    rights = Rights([Operator("alice", ("*",), ("*",))])
    settings = PolicySettings(rules={"pump": rules or RuleSet()})
    policy = Policy(settings, ["pump"], rights=rights, records=records)
    file = MemoryFile()
    for row in rows:
        file.put(*row[:3], time_s=row.time_s, data=row.data, limit=row.limit)
    history = HistoryService(
        state_dir,
        [setup],
        boot=boot,
        publish_event=lambda *_: None,
        policy=policy,
        make_file=lambda *_: file,
        records=records,
    )
    here = MotorSite(bus, clock, sink, history, file)
    services = StarterServices(past=history)
    services.add(telemetry)
    router.add(telemetry)
    bus_of_records.connect(policy, services, history, sink)
    telemetry.on_readings = partial(history.take_readings, "pump")
    telemetry.start()
    services.start()
    history.start()
    task = asyncio.create_task(line.run())
    yield here
    await telemetry.close()
    await services.close()
    await history.close()
    task.cancel()
    await asyncio.wait((task,))
