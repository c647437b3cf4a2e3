"""A line with starters that answer from their registers, and a sink that keeps what it is given."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Any, TypeVar

from gateway.contract import EventRecord, Record, ResultRecord
from gateway.line.client import LineClient
from gateway.line.rtu.outcome import TOO_LATE, Answered, Outcome, Refused, Silent
from gateway.line.scheduler.requests import Poll, Priority
from gateway.modbus.device_id import DeviceIdentification, ReadDeviceIdentification
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil, WriteCoils, WriteRegister, WriteRegisters

R = TypeVar("R")

TRANSACTION_S = 0.02

READY, AT_SPEED, FAULT = 0x4102, 0x4123, 0x8000  # of VB01 (ssw07 4.2.1)
VB01, P014 = 5001, 14
RUN_COIL = 100


class RecordingSink:
    """Keeps all records in order."""

    def __init__(self) -> None:
        self.records: list[Record] = []

    def put(self, record: Record) -> None:
        self.records.append(record)

    def of(self, kind: type[R]) -> list[R]:
        return [record for record in self.records if isinstance(record, kind)]

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
        self.coils: dict[int, bool] = {}
        self.objects: dict[int, str] | None = None
        self.on_write: Callable[[Request], None] = lambda request: None

    def answer(self, request: Request) -> Any:
        """Return what the request's reply says; KeyError for what is not there."""
        match request:
            case ReadHoldingRegisters():
                return tuple(self.holding[address] for address in _run(request))
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
    """A LineClient whose requests take 20 ms each, one after the other."""

    name = "pumps"
    timing = LineTiming(19200, Framing.parse("8E1"))

    def __init__(self, unit: FakeUnit) -> None:
        self.unit = unit
        self.sent: list[Sent] = []
        self.polls: dict[str, Poll] = {}
        self.every_s: dict[str, float] = {}
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
        try:
            return Answered(self.unit.answer(request), at_s=at_s, response_time_s=0.005)
        except KeyError:
            return Refused(2, at_s=at_s)

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

    stretch = 1.0

    def retry_refused(self, unit: int) -> None:
        pass

    def set_deadline(self, unit: int, seconds: float | None) -> None:
        pass

    def expect_silence(self, unit: int, seconds: float) -> None:
        pass


def make_unit() -> FakeUnit:
    """Return an SSW-07 that is ready for a start, with a motor at rest."""
    unit = FakeUnit()
    unit.holding = dict.fromkeys(range(1000), 0) | {VB01: READY, 5003: 0, 5006: 0}
    unit.coils = dict.fromkeys(range(16), False) | dict.fromkeys(range(100, 108), False)
    unit.objects = {0: "WEG", 1: "SSW-07 85.0A", 2: "V1.60"}
    return unit


def _run(request: ReadHoldingRegisters | ReadCoils) -> range:
    return range(request.address, request.address + request.count)
