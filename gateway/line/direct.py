"""A line without polls for one command while no gateway runs, and a bare port for a scan."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from types import TracebackType
from typing import Self

from gateway.errors import PortLostError
from gateway.line.client import LineClient, post_here
from gateway.line.events import EventQueue, LineEvent, PortChanged, Trace, deliver
from gateway.line.line import Line
from gateway.line.port.base import ClosesLate, Port, PortOpener
from gateway.line.rtu.forms import ANYONE, Forms
from gateway.line.rtu.master import RtuMaster
from gateway.line.rtu.outcome import Outcome
from gateway.line.rtu.transaction import ALLOWANCE_S
from gateway.modbus import LineTiming, Request


@asynccontextmanager
async def exclusive_line(
    name: str,
    opener: PortOpener,
    timing: LineTiming,
    *,
    allowance_s: float = ALLOWANCE_S,
    forms: Forms = ANYONE,
) -> AsyncIterator[LineClient]:
    """Serve a line as long as the context lasts; PortError when its port cannot be had.

    `forms` are those of the only starter that is asked.
    A port that is lost later is not opened again: whatever is asked then ends unsent.
    """
    port = await opener()
    opened = asyncio.Event()

    def handle(event: LineEvent) -> None:
        if isinstance(event, PortChanged):
            opened.set()

    line = Line(
        name=name,
        opener=_Once(opener.name, port),
        timing=timing,
        polls=(),
        events=EventQueue(lambda batch: deliver(batch, handle)),
        allowance_s=allowance_s,
        forms=forms,
    )
    task = asyncio.create_task(line.run(), name=f"exclusive {name}")
    try:
        await opened.wait()
        yield LineClient(line, post_here)
    finally:
        task.cancel()
        await asyncio.wait([task])


class _Once:
    """Hands out a port that is open already, and no other."""

    def __init__(self, name: str, port: Port) -> None:
        self._name = name
        self._port: Port | None = port

    @property
    def name(self) -> str:
        return self._name

    async def __call__(self) -> Port:
        port, self._port = self._port, None
        if port is None:
            raise PortLostError(self._name, "lost while in use")
        return port


class Survey:
    """An open port; as a context, so that it is closed in any case. Entering raises PortError.

    Leaving it waits until the port is closed, so that the next survey can open it with another setting.
    """

    def __init__(self, opener: PortOpener, timing: LineTiming, *, allowance_s: float = ALLOWANCE_S) -> None:
        self.timing = timing
        self._opener = opener
        self._allowance_s = allowance_s
        self._port: Port | None = None
        self._master: RtuMaster | None = None

    async def __aenter__(self) -> Self:
        self._port = await self._opener()
        self._master = RtuMaster(
            self.timing, allowance_s=self._allowance_s, note_frame=Trace(self._opener.name).note
        )
        self._master.use(self._port)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        if self._port is None:
            return
        self._port.close()
        if isinstance(self._opener, ClosesLate):
            await self._opener.wait_closed()

    async def ask(self, unit: int, request: Request, *, response_time_s: float) -> Outcome:
        """Send a read and return its outcome; ValueError for a write, PortLostError."""
        if request.is_write:
            raise ValueError("a survey only reads")
        if self._master is None:
            raise ValueError("the survey has not begun")
        return await self._master.transact(unit, request, response_time_s=response_time_s)
