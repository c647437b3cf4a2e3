"""Lines on the lines' own thread, for tests."""

from __future__ import annotations

import asyncio
import threading

from gateway.line.client import LineClient
from gateway.line.rtu.outcome import Outcome, Silent
from gateway.line.scheduler.requests import Priority
from gateway.line.thread import LineHost
from gateway.modbus.reads import ReadHoldingRegisters
from tests.line.fakes import RESPONSE_TIME_S, TIMING, FakeOpener, FakePort, Listener, Units, poll

READ = ReadHoldingRegisters(100, 2)
NO_PORT = Silent("port closed", is_sent=False)
LONG_S = 10.0


class WaitingListener(Listener):
    """A Listener that tells when something was told, and on which thread."""

    def __init__(self) -> None:
        super().__init__()
        self.news: asyncio.Queue[str] = asyncio.Queue()
        self.order: list[str] = []

    def _note(self, text: str) -> None:
        assert threading.current_thread() is threading.main_thread()
        self.order.append(text)
        self.news.put_nowait(text)

    def on_poll(self, line: str, key: str, unit: int, outcome: Outcome) -> None:
        self._note(f"{line} poll {key}")

    def on_unit(self, line: str, unit: int, is_answering: bool, reason: str, frames: tuple[str, ...]) -> None:
        self._note(f"{line} unit {unit}")

    def on_port(self, line: str, is_open: bool, reason: str) -> None:
        self._note(f"{line} port {is_open}")

    async def hear(self, text: str) -> None:
        async with asyncio.timeout(LONG_S):
            while await self.news.get() != text:
                pass


def fake_opener() -> FakeOpener:
    return FakeOpener(lambda: FakePort(Units({1})))


def add(host: LineHost, opener: FakeOpener, name: str = "pumps", every_s: float = 10.0) -> LineClient:
    return host.add_line(name=name, opener=opener, timing=TIMING, polls=[poll("a", every_s=every_s)])


async def ask(line: LineClient) -> Outcome:
    return await line.transact(1, READ, response_time_s=RESPONSE_TIME_S, lane=Priority.COMMAND)
