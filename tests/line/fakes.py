"""A line in virtual time: every byte has its place on the wire, and too early a request fails the test."""

from __future__ import annotations

import asyncio
import heapq
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import inf
from operator import itemgetter

from gateway.errors import PortError, PortLostError
from gateway.line.client import LineClient, post_here
from gateway.line.events import LineEvent, PollResult, PortChanged, Trace, UnitChanged
from gateway.line.line import Line
from gateway.line.rtu.forms import ANYONE, Alternate, Forms
from gateway.line.rtu.master import RtuMaster
from gateway.line.rtu.outcome import Outcome
from gateway.line.scheduler.requests import Poll, Priority
from gateway.modbus import adu
from gateway.modbus.codes import Function
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.server import decode_request
from gateway.modbus.timing import Framing, LineTiming
from tests.local_host import local_events

TIMING = LineTiming(19200, Framing.parse("8E1"))
RESPONSE_TIME_S = 0.010
DELAY_S = 0.005  # of the fake units


@dataclass(frozen=True)
class Said:
    """Bytes that somebody puts on the line so long after the request's last byte."""

    data: bytes
    delay_s: float = DELAY_S
    in_chunks_of: int | None = None  # None: handed over at once, when the last has arrived
    gap_s: float = 0.0  # between chunks


Answer = Callable[[bytes], Iterable[Said]]


def no_reply(frame: bytes) -> Iterable[Said]:
    """Answer nothing."""
    return ()


class FakePort:
    """A Port on a line where a request that starts before 3.5 characters of silence is an error."""

    def __init__(self, answer: Answer, timing: LineTiming = TIMING) -> None:
        self.answer = answer
        self.timing = timing
        self.sent: list[tuple[float, bytes]] = []
        self.shortest_silence_s = inf
        self.is_closed = False
        self.closed_s = inf
        self.may_be_disturbed = False  # what is sent into the bytes of others is no error
        self._loop = asyncio.get_running_loop()
        self._wire_end_s = -inf  # of the last byte on the line so far, ours included
        self._arrivals: list[tuple[float, int, bytes]] = []
        self._serial = 0
        self._last_byte_s = -inf
        self._lost = False
        self._waiter: asyncio.Future[None] | None = None

    @property
    def last_byte_s(self) -> float:
        return self._last_byte_s if not self._has_arrived() else max(self._last_byte_s, self._newest_s())

    def write(self, frame: bytes) -> None:
        if self._lost:
            raise PortLostError("fake", "lost")
        now_s = self._loop.time()
        served_s = max((at_s for at_s, _, _ in self._arrivals if at_s <= now_s), default=-inf)
        silence_s = now_s - max(self._wire_end_s, self._last_byte_s, served_s)
        self.shortest_silence_s = min(self.shortest_silence_s, silence_s)
        is_silent = silence_s > self.timing.silence_s - 1e-9
        assert is_silent or self.may_be_disturbed, f"sent after {silence_s} s of silence"
        self.sent.append((now_s, frame))
        end_s = now_s + self.timing.wire_s(len(frame))
        self._wire_end_s = end_s
        for said in self.answer(frame):
            self.say(said, end_s)

    async def read(self, *, until_s: float, count: int = 1) -> bytes:
        while not self._has_arrived():
            if self._lost:
                raise PortLostError("fake", "lost")
            if self._loop.time() >= until_s:
                return b""
            next_s = min([until_s, *(at_s for at_s, _, _ in self._arrivals[:1])])
            self._waiter = self._loop.create_future()
            timer = self._loop.call_at(next_s, self._wake)
            try:
                await self._waiter
            finally:
                timer.cancel()
        taken = b""
        while self._has_arrived():
            at_s, _, data = heapq.heappop(self._arrivals)
            self._last_byte_s = at_s
            taken += data
        return taken

    def close(self) -> None:
        if not self.is_closed:
            self.closed_s = self._loop.time()
        self.is_closed = self._lost = True

    def say(self, said: Said, from_s: float | None = None) -> None:
        """Put bytes on the line, counted from then or from now."""
        start_s = (self._loop.time() if from_s is None else from_s) + said.delay_s
        size = said.in_chunks_of or len(said.data)
        for at in range(0, len(said.data), size):
            chunk = said.data[at : at + size]
            start_s += self.timing.wire_s(len(chunk))
            self._deliver(start_s, chunk)
            start_s += said.gap_s

    def hang_up(self) -> None:
        self._lost = True
        self._wake()

    def _deliver(self, at_s: float, data: bytes) -> None:
        self._serial += 1
        heapq.heappush(self._arrivals, (at_s, self._serial, data))
        self._wake()

    def _has_arrived(self) -> bool:
        return bool(self._arrivals) and self._arrivals[0][0] <= self._loop.time()

    def _newest_s(self) -> float:
        return max(at_s for at_s, _, _ in self._arrivals if at_s <= self._loop.time())

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)


@dataclass
class Units:
    """Starters that answer every read with `address + i`, every write with its acknowledgement."""

    alive: set[int]
    delay_s: float = DELAY_S
    in_chunks_of: int | None = None

    def __call__(self, frame: bytes) -> Iterable[Said]:
        unit, pdu = adu.decode(frame)
        if unit not in self.alive:
            return ()
        return (Said(adu.encode(unit, reply_pdu(pdu)), self.delay_s, self.in_chunks_of),)


def reply_pdu(pdu: bytes) -> bytes:
    request = decode_request(pdu)
    if request.function in (Function.READ_HOLDING_REGISTERS, Function.READ_INPUT_REGISTERS):
        return request.encode_reply(words_of(request))
    return request.encode_reply()


def words_of(request: ReadHoldingRegisters) -> tuple[int, ...]:
    return tuple((request.address + i) & 0xFFFF for i in range(request.count))


def master(port: FakePort) -> RtuMaster:
    made = RtuMaster(port.timing, note_frame=Trace("line").note)
    made.use(port)
    return made


async def ask(port: FakePort, request: Request, unit: int = 1) -> Outcome:
    """Do one transaction on a line of its own."""
    return await master(port).transact(unit, request, response_time_s=RESPONSE_TIME_S)


class FakeOpener:
    """Opens a new fake port each time, unless `failure` is set."""

    name = "fake"

    def __init__(self, make_port: Callable[[], FakePort]) -> None:
        self.make_port = make_port
        self.failure: str | None = None
        self.tried_s: list[float] = []
        self.ports: list[FakePort] = []
        self.opened = asyncio.Event()

    async def __call__(self) -> FakePort:
        self.tried_s.append(asyncio.get_running_loop().time())
        if self.failure is not None:
            raise PortError(self.name, self.failure)
        self.ports.append(self.make_port())
        self.opened.set()
        return self.ports[-1]


class Listener:
    """Collects the events of a line, with their times."""

    def __init__(self) -> None:
        self.polls: list[tuple[float, str, int, Outcome]] = []
        self.units: list[tuple[float, int, bool, str, tuple[str, ...]]] = []
        self.ports: list[tuple[float, bool, str]] = []

    def handle(self, event: LineEvent) -> None:
        now_s = asyncio.get_running_loop().time()
        match event:
            case PollResult():
                self.polls.append((now_s, event.key, event.unit, event.outcome))
            case UnitChanged():
                self.units.append((now_s, event.unit, event.is_answering, event.reason, event.frames))
            case PortChanged():
                self.ports.append((now_s, event.is_open, event.reason))


class LineRig:
    """A running line on a fake port: `async with LineRig(units, polls) as rig`."""

    def __init__(
        self,
        answer: Answer,
        polls: Iterable[Poll],
        timing: LineTiming = TIMING,
    ) -> None:
        self.listener = Listener()
        self.opener = FakeOpener(lambda: FakePort(answer, timing))
        self.line = Line(
            name="pumps",
            opener=self.opener,
            timing=timing,
            polls=tuple(polls),
            events=local_events(self.listener.handle),
        )
        self.client = LineClient(self.line, post_here)

    @property
    def port(self) -> FakePort:
        return self.opener.ports[-1]

    async def __aenter__(self) -> LineRig:
        self.task = asyncio.create_task(self.line.run())
        await asyncio.sleep(0.0001)  # the port has been opened, or not; nothing is sent yet
        return self

    async def __aexit__(self, *_: object) -> None:
        if not self.task.done():
            self.task.cancel()
        await asyncio.wait([self.task])
        if not self.task.cancelled():
            self.task.result()

    async def transact(self, unit: int, request: Request, lane: Priority = Priority.COMMAND) -> Outcome:
        return await self.client.transact(unit, request, response_time_s=RESPONSE_TIME_S, lane=lane)


ALTERNATES = 8


def longer(request: Request) -> tuple[Alternate, ...]:
    """Return reads of some registers more, as the families' do."""
    assert isinstance(request, ReadHoldingRegisters)
    count = request.count
    return tuple(
        (ReadHoldingRegisters(request.address, count + more), itemgetter(slice(count)))
        for more in range(1, ALTERNATES + 1)
    )


LONGER = Forms(longer, ANYONE.fences)


def poll(key: str, unit: int = 1, every_s: float = 1.0, address: int = 0, count: int = 10) -> Poll:
    request = ReadHoldingRegisters(address, count)
    return Poll(
        key,
        unit,
        request,
        every_s,
        RESPONSE_TIME_S,
        forms=LONGER,
    )


async def until(is_true: Callable[[], bool]) -> None:
    """Let the loop run until something has come about in a thread or in the kernel."""
    async with asyncio.timeout(10.0):
        while not is_true():  # noqa: ASYNC110 - neither of them sets an event
            await asyncio.sleep(0)
