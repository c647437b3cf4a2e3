"""A bare port for a command that reads while no gateway has the line: `scan`, `doctor`."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from gateway.line.events import Trace
from gateway.line.port.base import ClosesLate, Port, PortOpener
from gateway.line.rtu.master import RtuMaster
from gateway.line.rtu.transaction import ALLOWANCE_S, Outcome
from gateway.modbus import LineTiming, Request


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

    @property
    def is_echoing(self) -> bool:
        """Return whether the adapter has repeated what it sent."""
        return self._master is not None and self._master.is_echoing

    async def ask(self, unit: int, request: Request, *, response_time_s: float) -> Outcome:
        """Send a read and return its outcome; ValueError for a write, PortLostError."""
        if request.is_write:
            raise ValueError("a survey only reads")
        if self._master is None:
            raise ValueError("the survey has not begun")
        return await self._master.transact(unit, request, response_time_s=response_time_s)
