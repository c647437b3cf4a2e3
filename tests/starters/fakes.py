"""A line with starters that answer from their registers, and a sink that keeps what it is given."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf
from typing import Any, TypeVar

from gateway.families.profile.load import load_profile
from gateway.line.client import LineClient
from gateway.line.rtu.outcome import TOO_LATE, Answered, Outcome, Refused, Silent
from gateway.line.scheduler.requests import Poll, Priority
from gateway.modbus.device_id import DeviceIdentification, ReadDeviceIdentification
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil, WriteCoils, WriteRegister, WriteRegisters
from gateway.records import EventRecord, Record, ResultRecord, StateRecord, ValueRecord

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
    lane: Priority


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
                return DeviceIdentification(dict(self.objects))
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


class FakeLineClient(LineClient):
    """A LineClient whose requests take 20 ms each, one after the other.

    `rules` decide on outcomes before the unit does: the first that returns one wins.
    """

    name = "pumps"
    timing = LineTiming(19200, Framing.parse("8E1"))

    def __init__(self, unit: FakeUnit) -> None:
        self.unit = unit
        self.sent: list[Sent] = []
        self.deadlines_s: dict[int, float | None] = {}
        self.rules: list[Callable[[Request], Outcome | None]] = []
        self.polls: dict[str, Poll] = {}
        self.every_s: dict[str, float] = {}
        self.expedited: list[str] = []
        self.expected_silence: list[tuple[int, float]] = []
        self._bus = asyncio.Lock()

    @property
    def writes(self) -> list[Request]:
        return [sent.request for sent in self.sent if sent.request.is_write]

    def transact(
        self,
        unit: int,
        request: Request,
        *,
        response_time_s: float,
        lane: Priority,
        until_s: float = inf,
        is_literal: bool = False,
    ) -> asyncio.Future[Outcome]:
        work = self._transact(unit, request, response_time_s=response_time_s, lane=lane, until_s=until_s)
        return asyncio.ensure_future(work)

    async def _transact(
        self, unit: int, request: Request, *, response_time_s: float, lane: Priority, until_s: float
    ) -> Outcome:
        assert unit == 7
        assert response_time_s > 0
        try:
            async with asyncio.timeout_at(None if until_s == inf else until_s):
                await self._bus.acquire()
        except TimeoutError:
            return Silent(TOO_LATE, is_sent=False)
        try:
            now_s = asyncio.get_running_loop().time()
            if now_s > until_s:
                return Silent(TOO_LATE, is_sent=False)
            self.sent.append(Sent(now_s, request, lane))
            outcome = self.outcome_of(request, at_s=now_s + TRANSACTION_S)
            await asyncio.sleep(TRANSACTION_S)
            return outcome
        finally:
            self._bus.release()

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

    def expedite(self, key: str) -> None:
        assert key in self.polls
        self.expedited.append(key)

    unit_count = 1
    stretch = 1.0

    def retry_refused(self, unit: int) -> None:
        pass

    def set_deadline(self, unit: int, seconds: float | None) -> None:
        self.deadlines_s[unit] = seconds

    def expect_silence(self, unit: int, seconds: float) -> None:
        self.expected_silence.append((unit, seconds))


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
