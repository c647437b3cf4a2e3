"""Lines on the lines' own thread, for tests."""

from __future__ import annotations

import asyncio
import threading

from gateway.line.client import LineClient
from gateway.line.events import LineEvent, PollResult, PortChanged, UnitChanged
from gateway.line.rtu.outcome import Outcome, Silent
from gateway.line.scheduler.requests import Priority
from gateway.line.thread import LineHost
from gateway.modbus.reads import ReadHoldingRegisters
from tests.line.fakes import RESPONSE_TIME_S, TIMING, FakeOpener, FakePort, Listener, Units, poll

READ = ReadHoldingRegisters(100, 2)
NO_PORT = Silent("port closed", is_sent=False)
LONG_S = 10.0


class WaitingListener(Listener):
    """A Listener that can be waited for, and checks on which thread it is called."""

    def __init__(self) -> None:
        super().__init__()
        self.news: asyncio.Queue[str] = asyncio.Queue()
        self.order: list[str] = []

    def _note(self, text: str) -> None:
        assert threading.current_thread() is threading.main_thread()
        self.order.append(text)
        self.news.put_nowait(text)

    def handle(self, event: LineEvent) -> None:
        match event:
            case PollResult():
                self._note(f"{event.line} poll {event.key}")
            case UnitChanged():
                self._note(f"{event.line} unit {event.unit}")
            case PortChanged():
                self._note(f"{event.line} port {event.is_open}")

    async def wait_for(self, text: str) -> None:
        async with asyncio.timeout(LONG_S):
            while await self.news.get() != text:
                pass


def fake_opener() -> FakeOpener:
    return FakeOpener(lambda: FakePort(Units({1})))


def add(host: LineHost, opener: FakeOpener, name: str = "pumps", every_s: float = 10.0) -> LineClient:
    return host.add_line(name=name, opener=opener, timing=TIMING, polls=[poll("a", every_s=every_s)])


async def ask(line: LineClient, *, response_time_s: float = RESPONSE_TIME_S) -> Outcome:
    return await line.transact(1, READ, response_time_s=response_time_s, lane=Priority.COMMAND)
