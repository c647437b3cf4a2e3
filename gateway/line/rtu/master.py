"""One question at a time on a port that is quiet: written, its reply received and judged."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from math import inf

from gateway.line.port.base import DeliversLate, HoldsBack, Port
from gateway.line.rtu.bus_faults import BusFaults
from gateway.line.rtu.forms import ANYONE, EncodedRequest, FormChoice
from gateway.line.rtu.reply import Reception, judge, no_frame
from gateway.line.rtu.silence import NoteFrame, Silence
from gateway.line.rtu.strays import Strays
from gateway.line.rtu.transaction import ALLOWANCE_S, TOO_LATE, Answered, Garbled, Outcome, Refused, Silent
from gateway.modbus import LineTiming, Request, adu

SENT, RECEIVED = ">>", "<<"  # the directions of frames

_HEAD = 2  # unit and function
_FIRST_CHUNK_SIZE = 64  # bytes of a reply of unknown length that an adapter may hold back at first
_IN_DOUBT = "it may answer an earlier request"


class RtuMaster:
    """Asks on the port that it was given last; exactly one task uses it.

    The outstanding replies of the units outlive a port, and so does the adapter's known behaviour.
    """

    def __init__(
        self, timing: LineTiming, *, allowance_s: float = ALLOWANCE_S, note_frame: NoteFrame
    ) -> None:
        self.forms = FormChoice()
        self.bus_faults = BusFaults()
        self.strays = Strays(self.forms.outstanding, self.bus_faults)
        self.silence = Silence(timing, self.strays, note_frame)
        self.is_on_wire = False  # from the moment a request is written until its outcome is known
        self.written_s = -inf  # when the latest request was written
        self._character_s = timing.character_s
        self._gap_s = timing.silence_s + allowance_s
        self._allowance_s = allowance_s
        self._note_frame = note_frame
        self.is_echoing = False  # the adapter repeats what it sends
        self._port: Port
        self._time: Callable[[], float]

    def use(self, port: Port, *, time: Callable[[], float] | None = None) -> None:
        """Go on with a port that was just opened; its clock is by default that of the running loop."""
        self._port, self._time = port, time or asyncio.get_running_loop().time
        self.is_on_wire = False
        self.silence.use(port, self._time)

    def reset(self) -> bool:
        """Let nothing that was written reach the wire later; return whether the port is closed for that."""
        if not isinstance(self._port, DeliversLate):
            return False
        self._port.reset()
        return True

    async def transact(self, unit: int, request: Request, *, response_time_s: float) -> Outcome:
        """Ask a device of which nothing is known as soon as the line allows; raises as `send`."""
        wanted = EncodedRequest.of(unit, request)
        while True:
            noise = await self.silence.settle()
            if noise is not None:
                return noise
            sent = self.forms.choose(wanted, ANYONE, self._time())
            outcome = await self.send(sent, response_time_s=response_time_s)
            if not sent.is_fence or not isinstance(outcome, Answered | Refused):
                return outcome

    async def send(
        self,
        sent: EncodedRequest,
        *,
        response_time_s: float,
        until_s: float = inf,
        meanwhile: Callable[[], None] | None = None,
    ) -> Outcome:
        """Send a request now, the line being settled, and return its outcome, by its deadline.

        `meanwhile` is done once the request is on its way. After `until_s` nothing is sent: that is looked at
        last of all, since the process may be stopped at any moment before. Raises PortLostError; `is_on_wire`
        then says whether the request may have been sent.
        """
        if until_s < inf and self._is_past(until_s):
            return Silent(TOO_LATE, is_sent=False)
        self.is_on_wire = True
        self.strays.asked = sent.unit
        outcome: Outcome | None = None
        asked_s = self._time()
        try:
            self._port.write(sent.adu)
            self.written_s = self._time()
            end_s = self.written_s + len(sent.adu) * self._character_s
            self.silence.note_sent(end_s)
            self._note_frame(self.written_s, SENT, sent.adu)
            if meanwhile is not None:
                meanwhile()
            outcome = await self._receive(sent, end_s, response_time_s)
        finally:
            # No whole reply, also when this was cancelled or the port was lost: it may still come late.
            if not isinstance(outcome, Answered | Refused):
                self.forms.outstanding.add(sent.unit, sent.shape, asked_s)
        self.is_on_wire = False
        return outcome

    def _is_past(self, until_s: float) -> bool:
        """Return whether a frame that is written now would be late."""
        if isinstance(self._port, HoldsBack):
            self._port.hold()
        return self._time() > until_s

    async def _receive(self, sent: EncodedRequest, sent_end_s: float, response_time_s: float) -> Outcome:
        """Wait for the reply until its deadline. Nearly all come as they should: those are read here."""
        size, character_s = sent.reply_size, self._character_s
        deadline_s = sent_end_s + response_time_s + (size or adu.MAX_ADU_SIZE) * character_s
        deadline_s += self._allowance_s
        received, foreign = b"", None
        # The usual case: first the bytes of the shortest reply, which may be a refusal, then the rest.
        if size is not None and not (sent.is_mirrored or self.is_echoing):
            read = self._port.read
            received = await read(until_s=deadline_s, count=_HEAD)
            if _HEAD <= len(received) < size and received[:_HEAD] == sent.adu[:_HEAD]:
                received += await read(until_s=deadline_s, count=size - len(received))
            if len(received) == size and received.startswith(sent.head) and not adu.crc16(received):
                outcome = self._judge(sent, received, 0, sent_end_s)
                if not isinstance(outcome, Garbled):
                    return outcome
                received, foreign = b"", outcome
        return await self._receive_any(sent, received, foreign, sent_end_s, deadline_s, response_time_s)

    async def _receive_any(
        self,
        sent: EncodedRequest,
        received: bytes,
        foreign: Garbled | None,
        sent_end_s: float,
        deadline_s: float,
        response_time_s: float,
    ) -> Outcome:
        """Wait for the reply among echoes, late replies and noise; `received` may be part of it."""
        until_s = deadline_s
        # A reply of unknown length is waited for chunk by chunk, each as long as its first would take.
        if sent.reply_size is None:
            until_s += (_FIRST_CHUNK_SIZE - adu.MAX_ADU_SIZE) * self._character_s
        reception = Reception(sent, is_echoing=self.is_echoing)
        reception.feed(received)
        while True:
            # Several frames may lie in one chunk: a late reply of another request, then this one's.
            while (frame := reception.take_frame()) is not None:
                outcome = self._judge(sent, frame, len(reception.rest()), sent_end_s)
                if not isinstance(outcome, Garbled):
                    self.is_echoing = reception.has_echo or (self.is_echoing and sent.is_mirrored)
                    self.silence.drop(reception.rest())
                    return outcome
                foreign = outcome
            if self._time() >= until_s:
                break
            chunk = await self._port.read(until_s=until_s, count=reception.lacking())
            if not chunk:
                break
            reception.feed(chunk)
            until_s = min(deadline_s, max(until_s, self._port.last_byte_s + self._gap_s))
        # The deadline has passed: bytes without a frame are noise, none at all is silence.
        rest = reception.rest()
        self.is_echoing = self.is_echoing or reception.has_echo
        if rest:
            self._note_frame(self._port.last_byte_s, RECEIVED, rest)
            self.bus_faults.note_garbled(sent.unit, len(rest), sent.reply_size, self._time())
            return no_frame(rest)
        self.silence.listen(sent.unit, deadline_s + response_time_s)
        return foreign or Silent()

    def _judge(
        self, sent: EncodedRequest, frame: bytes, behind: int, sent_end_s: float
    ) -> Answered | Refused | Garbled:
        """Return what a whole frame says to this request; Garbled drops it. So many bytes came behind it."""
        at_s = self._port.last_byte_s - behind * self._character_s
        took_s = max(at_s - len(frame) * self._character_s - sent_end_s, 0.0)
        self._note_frame(at_s, RECEIVED, frame)
        pdu = frame[1:-2]
        said = judge(sent.unit, sent.request, frame[0], pdu, at_s=at_s, response_time_s=took_s)
        if not isinstance(said, str):
            if isinstance(said, Refused) and said.is_lasting:
                self.forms.give_up(sent, at_s)
            if self.forms.outstanding.believe(sent.unit, pdu):
                self.bus_faults.note_answer(sent.unit, frame, at_s)
                if isinstance(said, Answered) and sent.cut is not None:
                    return replace(said, value=sent.cut(said.value))
                return said
            said = _IN_DOUBT
        self.strays.count += len(frame)
        self.strays.drop(frame, self._time())
        return Garbled(said, frame)
