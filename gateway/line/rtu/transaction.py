"""One request and its reply on a port: in which form, when it is quiet, and how long both take at most."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from gateway.line.port.base import DeliversLate, Port
from gateway.line.rtu.bus_faults import BusFaults
from gateway.line.rtu.exchange import Exchange
from gateway.line.rtu.forms import ANYONE, EncodedRequest, FormChoice
from gateway.line.rtu.outcome import Answered, Outcome, Refused
from gateway.line.rtu.silence import NoteFrame, Silence
from gateway.line.rtu.strays import Strays
from gateway.modbus.adu import MAX_ADU_SIZE
from gateway.modbus.pdu import Request
from gateway.modbus.timing import LineTiming

ALLOWANCE_S = 0.02  # for adapters, drivers and this machine, on top of the unit's own response time

_ADU_EXTRA = 3  # bytes around a PDU: unit and CRC


class RtuMaster:
    """The parts of one open port; exactly one task uses them."""

    def __init__(
        self,
        port: Port,
        timing: LineTiming,
        *,
        allowance_s: float = ALLOWANCE_S,
        note_frame: NoteFrame,
        forms: FormChoice | None = None,  # those of this line, if a port was open before
        time: Callable[[], float] | None = None,  # the port's clock; None: the running loop's
    ) -> None:
        clock = time or asyncio.get_running_loop().time
        self.forms = forms or FormChoice()
        self.bus_faults = BusFaults()
        self.strays = Strays(self.forms.outstanding, self.bus_faults, clock)
        self.silence = Silence(port, timing, self.strays, clock, note_frame)
        self.exchange = Exchange(
            port,
            timing,
            self.silence,
            self.strays,
            self.bus_faults,
            self.forms,
            allowance_s=allowance_s,
            note_frame=note_frame,
            time=clock,
        )
        self._port = port
        self._time = clock

    def reset(self) -> bool:
        """Let nothing that was written reach the wire later; return whether the port is closed for that."""
        if not isinstance(self._port, DeliversLate):
            return False
        self._port.reset()
        return True

    async def transact(self, unit: int, request: Request, *, response_time_s: float) -> Outcome:
        """Ask a device of which nothing is known as soon as the line allows; raises as `Exchange.send`."""
        wanted = EncodedRequest.of(unit, request)
        while True:
            noise = await self.silence.settle()
            if noise is not None:
                return noise
            sent = self.forms.choose(wanted, ANYONE, self._time())
            outcome = await self.exchange.send(sent, response_time_s=response_time_s)
            if not sent.is_fence or not isinstance(outcome, Answered | Refused):
                return outcome


def request_wire_s(request: Request, timing: LineTiming) -> float:
    """Return how long the request is on the wire."""
    return timing.wire_s(len(request.encode()) + _ADU_EXTRA)


def reply_within_s(
    request: Request, timing: LineTiming, *, response_time_s: float, allowance_s: float
) -> float:
    """Return how long after the request's end its reply is waited for, at most."""
    size = request.reply_size()
    reply_s = timing.wire_s(MAX_ADU_SIZE if size is None else size + _ADU_EXTRA)
    return response_time_s + reply_s + allowance_s


def longest_s(
    request: Request, timing: LineTiming, *, response_time_s: float, allowance_s: float = ALLOWANCE_S
) -> float:
    """Return how long this request can keep others from the line: no reply, then listening for a late one."""
    within_s = reply_within_s(request, timing, response_time_s=response_time_s, allowance_s=allowance_s)
    return request_wire_s(request, timing) + within_s + max(response_time_s, timing.silence_s)
