"""A whole gateway without MQTT over two simulated starters that outlive it; every record with its moment."""

from __future__ import annotations

import asyncio
import json
import random
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gateway.app.record_log import log_failure
from gateway.contract import CommandAddress, Operator, Record, RecordBus, RecordWriter, ResultRecord, Topics
from gateway.errors import StartError
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.line import LineEvent, PollResult, PortChanged, UnitChanged
from gateway.line.client import LineClient, post_here
from gateway.line.events import EventQueue, deliver
from gateway.line.line import Line
from gateway.modbus.adu import decode
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil
from gateway.mqtt.commands import Incoming, IncomingCommands
from gateway.sim.bus.faults import Reply
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.core.power import MotorData
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from gateway.starters import TOKEN_EVERY_S as EVERY_S
from gateway.starters import (
    Commands,
    Dispatcher,
    Policy,
    PolicySettings,
    Rights,
    RuleSet,
    RunToken,
    StarterSetup,
    StarterTelemetry,
    Tokens,
    polls_of,
)
from gateway.store import Documents, Journal, Remembered
from gateway.system.clock import ClockReading, ClockWatch
from gateway.system.instance_lock import instance_lock
from gateway.system.stalls import SuspendWatch
from tests.virtual_time import VirtualClock

TIMING = LineTiming(19200, Framing.parse("8N2"))
NAMES = ("a", "b")
PAUSE_S, STAGGER_S, STARTS_PER_HOUR = 2.0, 1.5, 5
RULES = RuleSet(starts_per_hour=STARTS_PER_HOUR, minimum_pause_s=PAUSE_S, feeder="f", stagger_s=STAGGER_S)
OPERATORS = (Operator("alice", ("*",), ("*",)), Operator("bob", ("start", "stop"), ("a",)))
READS = (1, 2, 3, 4)  # function codes
SILENCE_S = 12.0  # so many polls are lost in it that a starter is offline
START_PDU, STOP_PDU = WriteCoil(100, True).encode(), WriteCoil(100, False).encode()  # ssw07 4.2.2


class TimedSink:
    """Keeps all records with the moment of their publication."""

    def __init__(self) -> None:
        self.records: list[tuple[float, Record]] = []

    def put(self, record: Record) -> None:
        self.records.append((asyncio.get_running_loop().time(), record))

    def of(self, kind: type[Any]) -> list[tuple[float, Any]]:
        return [(at_s, record) for at_s, record in self.records if isinstance(record, kind)]


class MemoryDocuments(Documents):
    """Documents in a dictionary, which outlives the gateway."""

    def __init__(self, bodies: dict[str, str]) -> None:
        super().__init__(self)  # type: ignore[arg-type]
        self._bodies = bodies

    def submit(self, _work: object, **_how: object) -> Future[None]:
        """The body is in the dictionary already."""
        done: Future[None] = Future()
        done.set_result(None)
        return done

    async def has_done(self, _future: object, _within_s: float) -> bool:
        return True


class MemoryJournal(Journal):
    """Keeps commands as the ledger does, in memory; it outlives the gateway."""

    trouble = ""

    def __init__(self) -> None:
        self.stored: dict[tuple[str, str], Remembered] = {}
        self.disk_s = 0.0  # how long the disk takes

    def note(self, result: ResultRecord, *, then: Callable[[], None] | None = None) -> None:
        if result.id:
            key = (result.client, result.id)
            earlier = self.stored.get(key, Remembered(result, may_be_written=False))
            self.stored[key] = earlier._replace(result=result)
        if then is not None:
            then()

    def after(self, then: Callable[[], None]) -> None:
        then()

    def forget(self, keys: Iterable[tuple[str, str]]) -> None:
        for key in keys:
            self.stored.pop(key, None)

    async def intend(self, result: ResultRecord) -> None:
        assert result.id
        await asyncio.sleep(self.disk_s)
        key = (result.client, result.id)
        self.stored[key] = self.stored[key]._replace(may_be_written=True)


class LostReplies:
    """An impairment: the unit acts, but nothing of what it answers arrives."""

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        assert decode(reply.adu)
        return ()


class LostWrites:
    """An impairment: writes act, but their answers are lost."""

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        return () if decode(reply.adu).pdu[0] in (5, 6, 15, 16) else (reply,)


def _note_requests(unit: SimulatedUnit, clock: VirtualClock) -> list[tuple[float, bytes]]:
    """Have a unit's requests noted, with their times."""
    asked: list[tuple[float, bytes]] = []
    handle = unit.handle

    def noting(pdu: bytes, now_s: float) -> bytes | None:
        asked.append((clock.now_s(), pdu))
        return handle(pdu, now_s)

    unit.handle = noting  # type: ignore[method-assign]  # that is the point of it
    return asked


def _hand_over(starters: dict[int, StarterTelemetry], event: LineEvent) -> None:
    """Hand what happens on the line to its starters, as the plant does."""
    match event:
        case PollResult():
            starters[event.unit].on_poll(event.key, event.outcome)
        case UnitChanged():
            starters[event.unit].on_unit(is_answering=event.is_answering, reason=event.reason)
        case PortChanged(is_open=False):
            for starter in starters.values():
                starter.on_unit(is_answering=False, reason=event.reason)


class GatewayWorld:
    """The starters on their line, the gateway of the moment, and the broker's connection to it."""

    def __init__(self) -> None:
        motor = MotorData(ramp_up_s=0.6, full_voltage_s=0.2, ramp_down_s=0.4, coast_s=0.5)
        units = [make_unit("ssw07", number, motor=motor) for number in (1, 2)]
        self.bus = SimulatedLine(TIMING, units)
        self.units = dict(zip(NAMES, units, strict=True))
        self.clock = VirtualClock(asyncio.get_running_loop())
        self.sink, self.bodies, self.journal = TimedSink(), dict[str, str](), MemoryJournal()
        self._asked = {name: _note_requests(unit, self.clock) for name, unit in self.units.items()}
        self._folder = TemporaryDirectory(prefix="model-")
        self.is_plugged = True
        self.plugs: list[tuple[float, bool]] = [(0.0, True)]
        self.disturbances_s: list[float] = []  # crashes, and the port going away
        self.connected_s = 0.0
        self._true_epoch_s = self.clock.epoch_s
        self._runs = 0
        self._boot()

    def _boot(self) -> None:
        self._runs += 1
        self._instance = ExitStack()
        self._instance.enter_context(instance_lock(Path(self._folder.name)))
        rights, by_address = Rights(OPERATORS), dict[int, StarterTelemetry]()
        self.boot = RunToken(f"run{self._runs}")
        self._tokens = Tokens(self.boot)
        self.made: list[tuple[float, str]] = []  # when, and the token; of this run
        self.connect()
        self._issuing = asyncio.create_task(self._issue())
        clock_watch = ClockWatch("auto", ask=lambda: self.is_clock_right, read=self._read_clocks)
        bus = RecordBus(log_failure)
        records = RecordWriter(bus, self.clock)
        self.policy = Policy(
            PolicySettings(rules=dict.fromkeys(NAMES, RULES), groups={"both": NAMES}),
            NAMES,
            rights=rights,
            records=records,
            documents=MemoryDocuments(self.bodies),
        )
        bus.connect(self.policy, self.sink)
        profile = load_profile("ssw07")
        setups = [StarterSetup(name, "x", number, profile, Variant()) for number, name in enumerate(NAMES, 1)]
        polls = [poll for setup in setups for poll in polls_of(setup)]
        scheduler = Line(
            name="x",
            opener=self.bus.opener(),
            timing=TIMING,
            polls=polls,
            events=EventQueue(partial(deliver, handle=partial(_hand_over, by_address)), polls_wait_s=0.0),
        )
        self.telemetries = {
            setup.name: StarterTelemetry(
                setup,
                line=LineClient(scheduler, post_here),
                records=records,
                lock_of=self.policy.motor_history.lock_of,
            )
            for setup in setups
        }
        self.dispatcher = Dispatcher(
            self.telemetries,
            records=records,
            journal=self.journal,
            policy=self.policy,
            set_baseline=lambda *_: {},
        )
        self.dispatcher.recall(list(self.journal.stored.values()))
        for telemetry in self.telemetries.values():
            by_address[telemetry.setup.address] = telemetry
            telemetry.start()
        self._serving = asyncio.create_task(scheduler.run())
        self._commands = Commands(
            self.dispatcher,
            self._tokens,
            clock=self.clock,
            clock_watch=clock_watch,
            suspend_watch=SuspendWatch(self.clock),
            restate=lambda: None,
            publish_event=lambda *event, **fields: None,
        )
        self.reception = IncomingCommands(
            self._commands,
            dispatcher=self.dispatcher,
            clock=self.clock,
            publish_event=lambda *event, **fields: None,
        )
        self._looking = asyncio.create_task(self._commands.run())

    @property
    def is_clock_right(self) -> bool:
        """Return whether the gateway's wall clock shows the true time: what an honest kernel says of it."""
        return self.clock.epoch_s == self._true_epoch_s

    def put_clock_right(self) -> None:
        self.clock.epoch_s = self._true_epoch_s

    def true_utc_s(self) -> float:
        """Return the time by everybody else's clock."""
        return self._true_epoch_s + self.clock.now_s()

    def token(self, age_s: float = 0.0) -> tuple[float, str]:
        """Return the newest token that is at least so old, after the time when it was made."""
        due_s = self.clock.now_s() - age_s
        return max((each for each in self.made if each[0] <= due_s), default=(float("-inf"), "never made"))

    def _read_clocks(self) -> ClockReading:
        return ClockReading(self.clock.now_s(), self.clock.utc_s(), "boot-1")

    async def _issue(self) -> None:
        while True:
            await asyncio.sleep(EVERY_S)
            self._issue_token()

    def _issue_token(self) -> None:
        self.made.append((self.clock.now_s(), self._tokens.issue(self.clock.now_s())))

    def connect(self) -> None:
        self.boot.connected(self.clock.now_s())
        self.connected_s = self.clock.now_s()
        self._issue_token()

    async def crash(self, *, step_s: float = 0.0) -> None:
        """End the gateway in the middle of whatever it does, and start it again with a clock that was set."""
        self.clock.epoch_s += step_s
        self.disturbances_s.append(self.clock.now_s())
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for telemetry in self.telemetries.values():
            await telemetry.close()
        self._instance.close()  # as the kernel does for a process that has ended
        self._boot()

    async def close(self) -> None:
        await self.dispatcher.close()
        for telemetry in self.telemetries.values():
            await telemetry.close()
        self._serving.cancel()
        self._looking.cancel()
        self._issuing.cancel()
        await asyncio.wait((self._serving, self._looking, self._issuing))
        self._instance.close()
        self._folder.cleanup()

    def second_instance_error(self) -> str:
        """Return how a second run of the same configuration ends; empty when it does not."""
        try:
            with instance_lock(Path(self._folder.name)):
                return ""
        except StartError as error:
            return str(error)

    def publish(
        self, starter: str, client: str, verb: str, *, is_retained: bool = False, **body: Any
    ) -> None:
        """Let a message arrive from the broker."""
        address = CommandAddress(starter, client, verb)
        incoming = Incoming(
            Topics("t").command(starter, client, verb), json.dumps(body).encode(), is_retained
        )
        self.reception.take(address, incoming, self.clock.now_s())

    async def stand_still(self, seconds: float) -> None:
        """Let what takes commands stand still for so long; what comes next has waited in the socket."""
        self._looking.cancel()
        await asyncio.sleep(seconds)
        self._looking = asyncio.create_task(self._commands.run())

    def plug(self, *, is_plugged: bool) -> None:
        self.disturbances_s.append(self.clock.now_s())
        self.is_plugged = is_plugged
        self.plugs.append((self.clock.now_s(), is_plugged))
        if is_plugged:
            self.bus.plug_in()
        else:
            self.bus.unplug()

    async def swap(self, starter: str) -> SimulatedUnit:
        """Put an SSW-06 in a starter's place, with a silence between; return it."""
        other = make_unit("ssw06", self.units[starter].address)
        await self._exchange(self.units[starter], other)
        return other

    async def swap_back(self, starter: str, other: SimulatedUnit) -> None:
        """Put the right starter back in its place, with a silence between."""
        await self._exchange(other, self.units[starter])

    async def _exchange(self, before: SimulatedUnit, after: SimulatedUnit) -> None:
        self.disturbances_s.append(self.clock.now_s())
        self.bus.remove(before)
        await asyncio.sleep(SILENCE_S)
        self.bus.add(after)
        self.disturbances_s.append(self.clock.now_s())

    def impair(self, starter: str, kind: str) -> None:
        address = self.units[starter].address
        self.bus.heal(address)
        if kind != "none":
            self.bus.impair(address, LostWrites() if kind == "writes" else LostReplies())

    def operate_locally(self, starter: str, *, is_start: bool) -> None:
        """Switch to local, press a key, switch back to remote."""
        unit: Any = self.units[starter]
        unit._set_remote(is_remote=False)
        (unit.keypad_start if is_start else unit.keypad_stop)()
        unit._set_remote(is_remote=True)

    def frames(self, starter: str, pdu: bytes) -> list[float]:
        """Return when such a write reached a starter."""
        return [write.at_s for write in self.units[starter].writes if write.pdu == pdu]

    def readings(self, starter: str) -> list[float]:
        """Return when a read reached a starter."""
        return [at_s for at_s, pdu in self._asked[starter] if pdu[0] in READS]

    def results(self, starters: Iterable[str]) -> list[tuple[float, ResultRecord]]:
        """Return the results, without what was only sent again."""
        results = self.sink.of(ResultRecord)
        return [(at_s, each) for at_s, each in results if each.starter in starters and not each.is_duplicate]
