"""A line of SSW-07s that answer after 5 ms, served in virtual time or by the lines' thread."""

from __future__ import annotations

import asyncio
import threading
from dataclasses import dataclass, replace
from itertools import pairwise
from random import Random
from types import TracebackType
from typing import Any

from gateway.line.client import LineClient
from gateway.line.events import LineEvent, PollResult, PortChanged, UnitChanged
from gateway.line.port.base import Port
from gateway.line.rtu.transaction import ALLOWANCE_S, Outcome
from gateway.line.scheduler.requests import Poll, Priority
from gateway.line.thread import LineHost
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.sim.bus.faults import Reply
from tests.rig.line import RigLine

TIMING = LineTiming(19200, Framing.parse("8E1"))
RESPONSE_TIME_S = 0.010
DELAY_S = 0.005  # of the units
READ = ReadHoldingRegisters(2, 2)  # P002 and P003, which the units of `Wires` answer with 1 and 2


def poll(key: str, unit: int = 1, every_s: float = 1.0, count: int = 2) -> Poll:
    return Poll(key, unit, ReadHoldingRegisters(2, count), every_s, RESPONSE_TIME_S)


@dataclass(frozen=True)
class InPlace:
    """Something else comes in the place of a reply."""

    frame: bytes

    def apply(self, reply: Reply, dice: Random) -> tuple[Reply, ...]:
        return (replace(reply, adu=self.frame),)


class Wires(RigLine):
    """Wires with some units, and an opener of their port that notes when it was called."""

    def __init__(self, count: int = 1, timing: LineTiming = TIMING, name: str = "pumps") -> None:
        loop = asyncio.get_running_loop()
        super().__init__(name, loop.call_later, loop.time)
        self.timing = timing
        self.bug: Exception | None = None  # in the opener
        self.tried_s: list[float] = []
        for address in range(1, count + 1):
            starter = self.add(f"u{address}", "ssw07", address)
            starter.unit.response_delay_s = lambda _: DELAY_S  # type: ignore[method-assign]
            for number, value in enumerate((1, 2, 3, 4), 2):
                starter.set_word(f"holding {number}", value)
        self.lay(timing)

    async def __call__(self) -> Port:
        self.tried_s.append(asyncio.get_running_loop().time())
        if self.bug is not None:
            raise self.bug
        return await self.bus.opener()()

    @property
    def sent(self) -> list[tuple[float, bytes]]:
        """The frames of the gateway: when, and the PDU."""
        return [(each.start_s, each.data[1:-2]) for each in self.bus.transcript if not each.sender]

    def silences_s(self) -> list[float]:
        """Return how long it was quiet before each request but the first."""
        frames = list(self.bus.transcript)
        return [after.start_s - before.end_s for before, after in pairwise(frames) if not after.sender]


class LineRig:
    """`async with LineRig(wires, polls) as rig`; events come as words, on the application's thread."""

    def __init__(self, wires: Wires, *polls: Poll, has_thread: bool = False) -> None:
        self.wires = wires
        self.host = LineHost(self._note, has_thread=has_thread)
        self.allowance_s = 1.0 if has_thread else ALLOWANCE_S  # a busy machine is no fault of the line
        self.order: list[str] = []
        self.ports: list[tuple[float, bool, str]] = []
        self.polls = 0
        self._news: asyncio.Queue[str] = asyncio.Queue()
        self.line = self.add(wires, *polls)

    def add(self, wires: Wires, *polls: Poll) -> LineClient:
        return self.host.add_line(
            name=wires.name, opener=wires, timing=wires.timing, polls=polls, allowance_s=self.allowance_s
        )

    async def __aenter__(self) -> LineRig:
        await self.host.start()
        await asyncio.sleep(0.0001)  # the port has been opened, or not; nothing is sent yet
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.host.stop()

    def transact(
        self, unit: int, request: Request, lane: Priority = Priority.COMMAND, **options: Any
    ) -> asyncio.Future[Outcome]:
        return self.line.transact(unit, request, response_time_s=RESPONSE_TIME_S, lane=lane, **options)

    async def until(self, words: str) -> None:
        """Wait for the next event of these words."""
        async with asyncio.timeout(10.0):
            while await self._news.get() != words:
                pass

    def _note(self, event: LineEvent) -> None:
        assert threading.current_thread() is threading.main_thread()
        match event:
            case PollResult():
                self.polls += 1
                words = f"poll {event.key}"
            case UnitChanged():
                words = f"unit {event.unit}"
            case PortChanged():
                self.ports.append((asyncio.get_running_loop().time(), event.is_open, event.reason))
                words = f"port {event.is_open}"
        self.order.append(f"{event.line} {words}")  # type: ignore[union-attr] # these three have it
        self._news.put_nowait(self.order[-1])
