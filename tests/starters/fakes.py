"""A line with starters that answer from their registers, and a sink that keeps what it is given."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeVar

from gateway.families.load import load_profile
from gateway.families.schema import Variant
from gateway.line.job import Lane, Poll
from gateway.line.outcome import Answered, Outcome, Refused, Silent
from gateway.modbus.identify import Identification, ReadDeviceIdentification
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil, WriteCoils, WriteRegister, WriteRegisters
from gateway.starters.commander import Commander
from gateway.starters.records import EventRecord, Record, ResultRecord, StateRecord, ValueRecord
from gateway.starters.request import CommandRequest
from gateway.starters.rights import Operator, Rights
from gateway.starters.sequence import Sequence
from gateway.starters.setup import StarterSetup
from gateway.starters.telemetry import StarterTelemetry
from tests.virtual_time import VirtualClock, run_virtually

R = TypeVar("R")

TRANSACTION_S = 0.02

RUNNING, ENABLED, ACCELERATING, FULL_VOLTAGE = 0x0001, 0x0002, 0x0008, 0x0020  # VB01 (ssw07 4.2.1)
DECELERATING, REMOTE, POWER, FAULT = 0x0080, 0x0100, 0x4000, 0x8000
READY = ENABLED | REMOTE | POWER
AT_SPEED = READY | RUNNING | FULL_VOLTAGE
VB01, VB03, P003, P014 = 5001, 5003, 3, 14
RUN_COIL = 100


class RecordingSink:
    """Keeps all records in order."""

    def __init__(self) -> None:
        self.records: list[Record] = []

    def put(self, record: Record) -> None:
        self.records.append(record)

    def of(self, kind: type[R]) -> list[R]:
        return [record for record in self.records if isinstance(record, kind)]

    def values(self, point: str) -> list[ValueRecord]:
        return [record for record in self.of(ValueRecord) if record.point == point]

    def states(self) -> list[str]:
        return [record.state for record in self.of(StateRecord)]

    def events(self) -> list[str]:
        return [record.code for record in self.of(EventRecord)]

    def phases(self, id_: str | None = None) -> list[tuple[str, str]]:
        return [(r.phase.value, r.code) for r in self.of(ResultRecord) if id_ is None or r.id == id_]

    def final(self, id_: str | None = None) -> ResultRecord:
        (final,) = [r for r in self.of(ResultRecord) if r.phase.is_final and (id_ is None or r.id == id_)]
        return final

    def clear(self) -> None:
        self.records.clear()


@dataclass(frozen=True)
class Sent:
    """One request that went out."""

    at_s: float
    request: Request
    lane: Lane


class FakeUnit:
    """One unit: registers and coils that can be read and written; what it lacks is refused."""

    def __init__(self) -> None:
        self.holding: dict[int, int] = {}
        self.input: dict[int, int] = {}
        self.coils: dict[int, bool] = {}
        self.objects: dict[int, str] | None = None
        self.on_write: Callable[[Request], None] = lambda request: None

    def answer(self, request: Request) -> Any:
        """Return what the request's reply says; KeyError for what is not there."""
        match request:
            case ReadHoldingRegisters():
                return tuple(self.holding[address] for address in _run(request))
            case ReadInputRegisters():
                return tuple(self.input[address] for address in _run(request))
            case ReadCoils():
                return tuple(self.coils[address] for address in _run(request))
            case ReadDeviceIdentification() if self.objects is not None:
                return Identification(dict(self.objects))
            case WriteCoil():
                self.coils[request.address] = request.is_on
            case WriteCoils():
                self.coils.update(enumerate(request.bits, request.address))
            case WriteRegister():
                self.holding[request.address] = request.word
            case WriteRegisters():
                self.holding.update(enumerate(request.words, request.address))
            case _:
                raise KeyError(request)
        self.on_write(request)
        return None


class FakeLineClient:
    """A LineClient whose requests take 20 ms each, one after the other.

    `rules` decide on outcomes before the unit does: the first that returns one wins.
    """

    name = "pumps"
    timing = LineTiming(19200, Framing.parse("8E1"))

    def __init__(self, unit: FakeUnit) -> None:
        self.unit = unit
        self.sent: list[Sent] = []
        self.rules: list[Callable[[Request], Outcome | None]] = []
        self.polls: dict[str, Poll] = {}
        self.every_s: dict[str, float] = {}
        self.hastened: list[str] = []
        self.expected_silence: list[tuple[int, float]] = []
        self._turn = asyncio.Lock()

    @property
    def writes(self) -> list[Request]:
        return [sent.request for sent in self.sent if sent.request.is_write]

    async def transact(self, unit: int, request: Request, *, response_time_s: float, lane: Lane) -> Outcome:
        assert unit == 7
        assert response_time_s > 0
        async with self._turn:
            now_s = asyncio.get_running_loop().time()
            self.sent.append(Sent(now_s, request, lane))
            outcome = self.outcome_of(request, at_s=now_s + TRANSACTION_S)
            await asyncio.sleep(TRANSACTION_S)
            return outcome

    def outcome_of(self, request: Request, *, at_s: float) -> Outcome:
        for rule in self.rules:
            outcome = rule(request)
            if outcome is not None:
                return outcome
        try:
            return Answered(self.unit.answer(request), at_s=at_s, response_time_s=0.005)
        except KeyError:
            return Refused(2, at_s=at_s)

    @contextmanager
    def silence(self, kind: type[Request] | tuple[type[Request], ...] = object) -> Iterator[None]:  # type: ignore[assignment]  # any request
        """Leave requests of a kind without answer and without effect."""

        def rule(request: Request) -> Outcome | None:
            return Silent() if isinstance(request, kind) else None

        self.rules.insert(0, rule)
        yield
        self.rules.remove(rule)

    def add_poll(self, poll: Poll) -> None:
        assert poll.key not in self.polls
        self.polls[poll.key] = poll
        self.every_s[poll.key] = poll.every_s

    def remove_poll(self, key: str) -> None:
        del self.polls[key]
        del self.every_s[key]

    def set_every(self, key: str, every_s: float) -> None:
        assert key in self.polls
        self.every_s[key] = every_s

    def hasten(self, key: str) -> None:
        assert key in self.polls
        self.hastened.append(key)

    def expect_silence(self, unit: int, seconds: float) -> None:
        self.expected_silence.append((unit, seconds))

    def figures(self) -> dict[str, Any]:
        return {}


@dataclass
class Rig:
    """One starter of a family on a fake line, read by hand: `poll` is one turn of all its polls."""

    family: str = "ssw07"
    variant: Variant = field(default_factory=Variant)
    every_s: float = 1.0
    is_enabled: bool = True

    def __post_init__(self) -> None:
        self.clock = VirtualClock(asyncio.get_running_loop())
        self.sink = RecordingSink()
        self.sequence = Sequence()
        self.unit = make_unit(self.family)
        self.line = FakeLineClient(self.unit)
        self.setup = StarterSetup(
            name="pump-1",
            line="pumps",
            address=7,
            profile=load_profile(self.family),
            variant=self.variant,
            every_s=self.every_s,
            is_enabled=self.is_enabled,
        )
        self.telemetry = StarterTelemetry(
            self.setup, line=self.line, sink=self.sink, clock=self.clock, sequence=self.sequence
        )
        for poll in self.telemetry.polls():
            self.line.add_poll(poll)

    async def online(self) -> Rig:
        """Start, answer every poll once and be identified; then forget what was said."""
        self.telemetry.start()
        self.poll()
        await asyncio.sleep(0.5)
        self.poll()
        self.sink.clear()
        self.line.sent.clear()
        return self

    def poll(self, *keys: str) -> None:
        """Let these polls (or all) have their turn now, in no time."""
        for key in keys or tuple(self.line.polls):
            outcome = self.line.outcome_of(self.line.polls[key].request, at_s=self.clock.now_s())
            self.telemetry.on_poll(key, outcome)

    async def poll_for(self, seconds: float) -> None:
        """Let all polls have their turn again and again, as often as configured for the status."""
        until_s = self.clock.now_s() + seconds
        while self.clock.now_s() < until_s:
            self.poll()
            await asyncio.sleep(self.every_s)

    def lose(self, reason: str = "no reply", frames: tuple[str, ...] = ()) -> None:
        self.telemetry.on_unit(is_answering=False, reason=reason, frames=frames)


def virtually(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Let an async test run to its end in virtual time."""

    @functools.wraps(test)
    def run(*args: Any, **kwargs: Any) -> None:
        run_virtually(test(*args, **kwargs))

    return run


def make_unit(family: str) -> FakeUnit:
    """Return a unit of a family that is ready for a start, with a motor at rest."""
    unit = FakeUnit()
    if family == "sst":
        unit.input = dict.fromkeys(range(43), 0) | {0: 330, 2: 0x0204, 3: 1, 9: 1234}
        unit.coils = dict.fromkeys(range(26), False) | {4: True, 25: True}
    elif family == "ssw900":
        unit.holding = dict.fromkeys(range(2000), 0) | {680: 0x0102, 685: 0x0012, 299: 0, 298: 77, 287: 0}
        rows = load_profile(family).parameters
        unit.holding[rows["S3.5.1"].address] = 2  # the RS-485 accessory is in slot 1
        unit.objects = {0: "WEG", 1: "SSW900", 2: "V1.20"}
    else:
        unit.holding = dict.fromkeys(range(1000), 0) | {VB01: READY, 5003: 0, 5006: 0}
        unit.coils = dict.fromkeys(range(16), False) | dict.fromkeys(range(100, 108), False)
        unit.objects = {0: "WEG", 1: f"SSW-{family[-2:]} 85.0A", 2: "V1.60"}
        if family == "ssw06":
            unit.holding[5000] = 15
    return unit


def _run(request: ReadHoldingRegisters | ReadInputRegisters | ReadCoils) -> range:
    return range(request.address, request.address + request.count)


@dataclass
class CommandRig(Rig):
    """The same with a commander; alice may do everything, victor only stop."""

    def __post_init__(self) -> None:
        super().__post_init__()
        rights = Rights([Operator("alice", ("*",), ("*",)), Operator("victor", ("stop",), ("*",))])
        self.commander = Commander(
            {self.setup.name: self.telemetry},
            rights=rights,
            sink=self.sink,
            clock=self.clock,
            sequence=self.sequence,
        )
        if self.family in ("ssw06", "ssw07"):
            self.unit.on_write = self._obey

    def submit(self, verb: str, id_: str | None = "1", **more: Any) -> None:
        fields = {"starter": "pump-1", "client": "alice", "args": {}, **more}
        self.commander.submit(CommandRequest(verb=verb, id=id_, received_s=self.clock.now_s(), **fields))

    def starts(self) -> int:
        """Return how many start frames went out."""
        return sum(isinstance(w, WriteCoil) and w.address == RUN_COIL and w.is_on for w in self.line.writes)

    def stops(self) -> list[Sent]:
        """Return the stop frames that went out."""
        return [
            sent
            for sent in self.line.sent
            if isinstance(sent.request, WriteCoil)
            and sent.request.address == RUN_COIL
            and not sent.request.is_on
        ]

    def _obey(self, request: Request) -> None:
        """Run at once and stop at once, as the coil says, or the masked word of the SSW-06."""
        if isinstance(request, WriteCoil) and request.address == RUN_COIL:
            self.unit.holding[VB01] = AT_SPEED if request.is_on else READY
        if isinstance(request, WriteRegister) and request.address == VB03 and request.word & 0x0100:
            self.unit.holding[VB01] = AT_SPEED if request.word & 0x0001 else READY
