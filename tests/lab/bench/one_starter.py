"""One SSW-07 on a line that answers at once from its registers, with a dispatcher; for `command_way`."""

from __future__ import annotations

import asyncio
from math import inf
from typing import Any

from gateway.contract import Operator, Record, RecordWriter, ResultRecord
from gateway.families import Variant, load_profile
from gateway.line import Answered, LineClient, Outcome, Poll, Priority, Refused
from gateway.modbus.device_id import DeviceIdentification, ReadDeviceIdentification
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil
from gateway.starters import (
    Dispatcher,
    Policy,
    PolicySettings,
    Rights,
    StarterSetup,
    StarterTelemetry,
    polls_of,
)
from tests.starters.world import MemoryJournal
from tests.virtual_time import VirtualClock

TRANSACTION_S = 0.02
READY, AT_SPEED, VB01, RUN_COIL = 0x4102, 0x4123, 5001, 100  # ssw07 4.2.1, 4.2.2
ADDRESS = 7


class RecordingSink:
    """Keeps all records in order."""

    def __init__(self) -> None:
        self.records: list[Record] = []

    def put(self, record: Record) -> None:
        self.records.append(record)

    def final(self, id_: str) -> ResultRecord:
        results = [each for each in self.records if isinstance(each, ResultRecord) and each.id == id_]
        (final,) = [each for each in results if each.phase.is_final]
        return final


class AnsweringLine(LineClient):
    """A LineClient whose requests take 20 ms each; its motor runs and stops at once, as coil 100 says."""

    name = "pumps"
    timing = LineTiming(19200, Framing.parse("8E1"))
    stretch = 1.0

    def __init__(self) -> None:
        self.holding = dict.fromkeys(range(1000), 0) | {VB01: READY, 5003: 0, 5006: 0}
        self.coils = dict.fromkeys((*range(16), *range(100, 108)), False)
        self.polls: dict[str, Poll] = {}
        self._bus = asyncio.Lock()

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
        return asyncio.ensure_future(self._transact(request))

    async def _transact(self, request: Request) -> Outcome:
        async with self._bus:
            await asyncio.sleep(TRANSACTION_S)
            return self.outcome_of(request, at_s=asyncio.get_running_loop().time())

    def outcome_of(self, request: Request, *, at_s: float) -> Outcome:
        try:
            return Answered(self._answer(request), at_s=at_s, response_time_s=0.005)
        except KeyError:
            return Refused(2, at_s=at_s)

    def _answer(self, request: Request) -> Any:
        match request:
            case ReadHoldingRegisters():
                return tuple(self.holding[request.address + each] for each in range(request.count))
            case ReadCoils():
                return tuple(self.coils[request.address + each] for each in range(request.count))
            case ReadDeviceIdentification():
                return DeviceIdentification({0: "WEG", 1: "SSW-07 85.0A", 2: "V1.60"})
            case WriteCoil():
                self.coils[request.address] = request.is_on
                if request.address == RUN_COIL:
                    self.holding[VB01] = AT_SPEED if request.is_on else READY
                return None
        raise KeyError(request)

    def add_poll(self, poll: Poll) -> None:
        self.polls[poll.key] = poll

    def remove_poll(self, key: str) -> None:
        del self.polls[key]

    def set_every(self, key: str, every_s: float) -> None: ...

    def expedite(self, key: str) -> None: ...

    def retry_refused(self, unit: int) -> None: ...

    def set_deadline(self, unit: int, seconds: float | None) -> None: ...

    def expect_silence(self, unit: int, seconds: float) -> None: ...


class OneStarter:
    """The starter as the gateway has it; alice may do everything."""

    def __init__(self) -> None:
        self.clock = VirtualClock(asyncio.get_running_loop())
        self.sink = RecordingSink()
        records = RecordWriter(self.sink, self.clock)
        self.line = AnsweringLine()
        setup = StarterSetup("pump-1", self.line.name, ADDRESS, load_profile("ssw07"), Variant())
        self.telemetry = StarterTelemetry(setup, line=self.line, records=records)
        for poll in polls_of(setup):
            self.line.add_poll(poll)
        rights = Rights((Operator("alice", ("*",), ("*",)),))
        self.dispatcher = Dispatcher(
            {setup.name: self.telemetry},
            records=records,
            journal=MemoryJournal(),
            policy=Policy(PolicySettings(), [setup.name], rights=rights, records=records),
            set_baseline=lambda *_: {},
        )

    async def online(self) -> None:
        """Start, answer every poll once and be identified; then forget what was said."""
        self.telemetry.start()
        self.poll()
        await asyncio.sleep(0.5)
        self.poll()
        self.sink.records.clear()

    def poll(self) -> None:
        """Answer all polls now, in no time."""
        for key in tuple(self.line.polls):
            if key in self.line.polls:  # else another answer of this round has replaced it
                request = self.line.polls[key].request
                self.telemetry.on_poll(key, self.line.outcome_of(request, at_s=self.clock.now_s()))
