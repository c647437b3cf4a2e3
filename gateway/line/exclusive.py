"""A line for oneself, without polls: for a command that works on one starter while no gateway runs."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from gateway.errors import PortLostError
from gateway.line.budget import ALLOWANCE_S
from gateway.line.client import LineClient, LocalLineClient
from gateway.line.job import Alternate
from gateway.line.outcome import Outcome
from gateway.line.port import Port, PortOpener
from gateway.line.scheduler import Scheduler
from gateway.modbus.pdu import Request
from gateway.modbus.timing import LineTiming


@asynccontextmanager
async def exclusive_line(
    name: str,
    opener: PortOpener,
    timing: LineTiming,
    *,
    allowance_s: float = ALLOWANCE_S,
    alternates_of: Callable[[Request], tuple[Alternate, ...]] = lambda _: (),
) -> AsyncIterator[LineClient]:
    """Serve a line as long as the context lasts; PortError when its port cannot be had.

    `alternates_of` returns other reads that say the same as one, of the only starter that is asked.
    A port that is lost later is not opened again: whatever is asked then ends unsent.
    """
    port = await opener()
    listener = _Listener()
    scheduler = Scheduler(
        name=name,
        opener=_Once(opener.name, port),
        timing=timing,
        polls=(),
        listener=listener,
        allowance_s=allowance_s,
        alternates_of=alternates_of,
    )
    task = asyncio.create_task(scheduler.run(), name=f"exclusive {name}")
    try:
        await listener.opened.wait()
        yield LocalLineClient(scheduler)
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


class _Listener:
    """Waits for the port; everything else is told to whoever asked."""

    def __init__(self) -> None:
        self.opened = asyncio.Event()

    def on_poll(self, line: str, key: str, unit: int, outcome: Outcome) -> None:
        """Never called: there are no polls."""

    def on_unit(self, line: str, unit: int, is_answering: bool, reason: str, frames: tuple[str, ...]) -> None:  # noqa: FBT001 - the seam's exact shape
        """Leave it to the outcomes."""

    def on_trouble(self, line: str, code: str, unit: int, text: str, frames: tuple[str, ...]) -> None:
        """Leave it to the log."""

    def on_port(self, line: str, is_open: bool, reason: str) -> None:  # noqa: ARG002, FBT001 - the seam's exact shape
        self.opened.set()
