"""A port for oneself with one setting, one question at a time: for a scan, which knows no units yet."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from gateway.line.budget import reply_within_s, request_wire_s
from gateway.line.outcome import Outcome
from gateway.line.port import ClosesLate, Port, PortOpener
from gateway.line.trace import Trace
from gateway.line.transaction import Transactor
from gateway.modbus.pdu import Request
from gateway.modbus.timing import LineTiming

ALLOWANCE_S = 0.02  # for adapters, drivers and this machine


class Survey:
    """An open port; as a context, so that it is closed in any case. Entering raises PortError.

    Leaving it waits until the port is closed, so that the next survey can open it with another setting.
    """

    def __init__(self, opener: PortOpener, timing: LineTiming, *, allowance_s: float = ALLOWANCE_S) -> None:
        self.timing = timing
        self._opener = opener
        self._allowance_s = allowance_s
        self._port: Port | None = None
        self._line: Transactor | None = None

    async def __aenter__(self) -> Self:
        self._port = await self._opener()
        trace = Trace(self._opener.name)
        self._line = Transactor(self._port, self.timing, allowance_s=self._allowance_s, trace=trace)
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
        """Send a read and return what became of it; ValueError for a write, PortLostError."""
        if request.is_write:
            raise ValueError("a survey only reads")
        if self._line is None:
            raise ValueError("the survey has not begun")
        return await self._line.transact(unit, request, response_time_s=response_time_s)


def silent_cost_s(request: Request, timing: LineTiming, *, response_time_s: float) -> float:
    """Return how long it takes to learn that a unit does not answer: a late reply is waited for too."""
    within_s = reply_within_s(request, timing, response_time_s=response_time_s, allowance_s=ALLOWANCE_S)
    return timing.silence_s + request_wire_s(request, timing) + within_s + response_time_s
