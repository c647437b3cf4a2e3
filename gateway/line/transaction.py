"""One request and its reply on a port, with the silences that RTU asks for [SERIAL 2.5.1.1]."""

from __future__ import annotations

import asyncio
from math import inf
from typing import assert_never

from gateway.line.budget import ALLOWANCE_S, reply_within_s
from gateway.line.hearing import MIRRORED, Hearing, judge
from gateway.line.outcome import Answered, Garbled, Outcome, Refused, Silent
from gateway.line.port import Port
from gateway.line.quarantine import Quarantine
from gateway.line.trace import Trace
from gateway.modbus import adu
from gateway.modbus.pdu import Request
from gateway.modbus.timing import BROADCAST_TURNAROUND_S, LineTiming

BABBLE_LIMIT_S = 1.0  # a line that is busy for longer without our asking is not waited for
LATE_FACTOR = 3.0  # a reply may come so many times later than it is waited for

_KEPT_STRAY = 256  # bytes; the longest frame
_FIRST_CHUNK_SIZE = (
    64  # bytes of a reply of unknown length that an adapter may hold back before the first shows
)


class Transactor:
    """Asks one question at a time on an open port; exactly one task uses it."""

    def __init__(
        self, port: Port, timing: LineTiming, *, allowance_s: float = ALLOWANCE_S, trace: Trace
    ) -> None:
        self._port = port
        self._timing = timing
        self._allowance_s = allowance_s
        self._trace = trace
        self._time = asyncio.get_running_loop().time
        self._own_end_s = self._time()  # who knows what was on the wire before the port was opened
        self._quarantine = Quarantine()
        self._stray = bytearray()
        self._is_echoing = False
        self.is_on_wire = False  # from the moment a request is written until its outcome is known
        self.written_s = -inf  # when the latest request was written
        self.stray_bytes = 0  # that nobody waited for, since the port was opened

    async def settle(self, unit: int | None = None) -> Garbled | None:
        """Wait until a request may be sent (to this unit): the line is silent, late replies are gone.

        Returns None when it may; Garbled when the line does not become quiet within about a second.
        """
        give_up_s = max(self._time(), self._quarantine.until_s(unit)) + BABBLE_LIMIT_S
        while True:
            quiet_s = self._quiet_from_s()
            if self._stray and self._time() >= quiet_s:
                self._quarantine.heard(bytes(self._stray))
                self._stray.clear()
            due_s = quiet_s if self._stray else max(quiet_s, self._quarantine.until_s(unit))
            chunk = await self._port.read(until_s=due_s)
            now_s = self._time()
            if chunk:
                self._drop(chunk)
            elif not self._stray and now_s >= max(self._quiet_from_s(), self._quarantine.until_s(unit)):
                return None
            if now_s >= give_up_s and now_s < self._quiet_from_s():
                tail = bytes(self._stray)
                self._stray.clear()
                return Garbled("the line is never quiet", tail, is_sent=False)

    def free_from_s(self, unit: int, request: Request) -> float:
        """Return from when on this may be sent, as far as late replies are concerned."""
        return self._quarantine.until_s(None if request.function in MIRRORED else unit)

    async def transact(self, unit: int, request: Request, *, response_time_s: float) -> Outcome:
        """Send a request as soon as the line allows, and return what became of it by its deadline.

        Raises PortLostError; `is_on_wire` then tells whether the request may have been sent.
        """
        noise = await self.settle(None if request.function in MIRRORED else unit)
        if noise is not None:
            return noise
        request_adu = adu.encode(unit, request.encode())
        self.is_on_wire = True
        self._port.write(request_adu)
        self.written_s = self._time()
        self._own_end_s = self.written_s + self._timing.wire_s(len(request_adu))
        self._trace.sent(self.written_s, request_adu)
        if unit == adu.BROADCAST:
            outcome = await self._turn_around()
        else:
            outcome = await self._hear(unit, request, request_adu, response_time_s)
        self.is_on_wire = False
        return outcome

    async def _hear(self, unit: int, request: Request, request_adu: bytes, response_time_s: float) -> Outcome:
        """Wait for the reply; judge it when it is whole, or whatever there is at the deadline."""
        sent_end_s = self._own_end_s
        deadline_s = sent_end_s + reply_within_s(
            request, self._timing, response_time_s=response_time_s, allowance_s=self._allowance_s
        )
        first_by_s = deadline_s
        if request.reply_size() is None:
            first_by_s = (
                sent_end_s + response_time_s + self._allowance_s + self._timing.wire_s(_FIRST_CHUNK_SIZE)
            )
        is_mirrored = request.function in MIRRORED
        hearing = Hearing(request_adu, is_mirrored=is_mirrored, is_echoing=self._is_echoing)
        began_s = await self._listen(hearing, first_by_s=first_by_s, deadline_s=deadline_s)
        at_s = self._port.last_byte_s
        if hearing.received:
            self._trace.received(at_s, hearing.received)
        whole = hearing.whole_reply()
        frame = hearing.reply() if whole is None else whole
        self.stray_bytes += len(hearing.reply()) - len(frame)
        outcome: Outcome = Silent()
        if frame:
            outcome = judge(frame, unit, request, at_s=at_s, response_time_s=max(began_s - sent_end_s, 0.0))
        self._learn_echo(hearing, outcome, is_mirrored=is_mirrored)
        self._guard(
            unit, outcome, sent_end_s=sent_end_s, deadline_s=deadline_s, response_time_s=response_time_s
        )
        return outcome

    async def _listen(self, hearing: Hearing, *, first_by_s: float, deadline_s: float) -> float:
        """Read until the reply is whole or will not come; return when its first byte began.

        Where the first byte is due before the deadline, only further bytes keep us listening so long.
        """
        gap_s = self._timing.silence_s + self._allowance_s
        began_s = inf
        until_s = first_by_s
        while self._time() < until_s and hearing.whole_reply() is None:
            chunk = await self._port.read(until_s=until_s)
            hearing.feed(chunk)
            if chunk:
                last_byte_s = self._port.last_byte_s
                until_s = min(deadline_s, max(until_s, last_byte_s + gap_s))
                if began_s == inf and not hearing.may_be_echo():
                    began_s = last_byte_s - self._timing.wire_s(len(hearing.reply()))
        return began_s

    async def _turn_around(self) -> Outcome:
        """Give every unit the time to act on a broadcast; none answers [SERIAL 2.4.1]."""
        end_s = self._own_end_s + BROADCAST_TURNAROUND_S
        while self._time() < end_s:
            self._drop(await self._port.read(until_s=end_s))
        return Silent("broadcast")

    def _guard(
        self, unit: int, outcome: Outcome, *, sent_end_s: float, deadline_s: float, response_time_s: float
    ) -> None:
        """See to it that a reply that may still come is not taken for the next answer."""
        match outcome:
            case Answered() | Refused():
                self._quarantine.end(unit)
            case Garbled(received=frame) if not self._quarantine.heard(frame):  # the reply itself, spoilt
                self._quarantine.begin(unit, line_until_s=deadline_s, unit_until_s=deadline_s)
            case Silent() | Garbled():
                self._quarantine.begin(
                    unit,
                    line_until_s=deadline_s + response_time_s,
                    unit_until_s=sent_end_s + LATE_FACTOR * (deadline_s - sent_end_s),
                )
            case _:
                assert_never(outcome)

    def _learn_echo(self, hearing: Hearing, outcome: Outcome, *, is_mirrored: bool) -> None:
        if hearing.has_echo:
            self._is_echoing = True
        elif isinstance(outcome, Answered) and not is_mirrored:
            self._is_echoing = False

    def _quiet_from_s(self) -> float:
        """Return when the line will have been silent for long enough, if nothing more comes."""
        return max(self._own_end_s, self._port.last_byte_s) + self._timing.silence_s

    def _drop(self, stray: bytes) -> None:
        """Count and forget bytes that nobody waited for; the last of them stay for the quarantine."""
        if stray:
            self.stray_bytes += len(stray)
            self._trace.strayed(self._port.last_byte_s, stray)
            self._stray += stray
            del self._stray[:-_KEPT_STRAY]
