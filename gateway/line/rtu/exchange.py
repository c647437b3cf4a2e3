"""One request written, its reply received and judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import inf

from gateway.errors import BadReplyError
from gateway.line.port.base import HoldsBack, Port
from gateway.line.rtu.bus_faults import BusFaults
from gateway.line.rtu.forms import EncodedRequest, FormChoice
from gateway.line.rtu.outcome import TOO_LATE, Answered, Garbled, Outcome, Refused, Silent
from gateway.line.rtu.reply import SHORTEST_REPLY, Reception, judge, no_frame
from gateway.line.rtu.silence import NoteFrame, Silence
from gateway.line.rtu.strays import Strays
from gateway.modbus import adu
from gateway.modbus.adu import crc16
from gateway.modbus.timing import LineTiming

SENT, RECEIVED = ">>", "<<"  # the directions of frames

_HEAD = 2  # unit and function
_FIRST_CHUNK_SIZE = 64  # bytes of a reply of unknown length that an adapter may hold back at first
_IN_DOUBT = "it may answer an earlier request"


class Exchange:
    """Asks one question at a time on a port that is quiet."""

    def __init__(
        self,
        port: Port,
        timing: LineTiming,
        silence: Silence,
        strays: Strays,
        bus_faults: BusFaults,
        forms: FormChoice,
        *,
        allowance_s: float,
        note_frame: NoteFrame,
        time: Callable[[], float],
    ) -> None:
        self.is_on_wire = False  # from the moment a request is written until its outcome is known
        self.written_s = -inf  # when the latest request was written
        self.character_s = timing.character_s
        self._port = port
        self._gap_s = timing.silence_s + allowance_s
        self._allowance_s = allowance_s
        self._silence = silence
        self._strays = strays
        self._bus_faults = bus_faults
        self._forms = forms
        self._note_frame = note_frame
        self._time = time
        self._is_echoing = False

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
        self._strays.asked = sent.unit
        outcome: Outcome | None = None
        asked_s = self._time()
        try:
            self._port.write(sent.adu)
            self.written_s = self._time()
            end_s = self.written_s + len(sent.adu) * self.character_s
            self._silence.note_sent(end_s)
            self._note_frame(self.written_s, SENT, sent.adu)
            if meanwhile is not None:
                meanwhile()
            if sent.unit == adu.BROADCAST:
                await self._silence.give_turnaround()
                outcome = Silent("broadcast")
            else:
                outcome = await self._receive(sent, end_s, response_time_s)
        finally:
            if not isinstance(outcome, Answered | Refused) and sent.unit != adu.BROADCAST:
                self._forms.outstanding.add(sent.unit, sent.shape, asked_s)
        self.is_on_wire = False
        return outcome

    def _is_past(self, until_s: float) -> bool:
        """Return whether a frame that is written now would be late."""
        if isinstance(self._port, HoldsBack):
            self._port.hold()
        return self._time() > until_s

    async def _receive(self, sent: EncodedRequest, sent_end_s: float, response_time_s: float) -> Outcome:
        """Wait for the reply until its deadline. Nearly all come as they should: those are read here."""
        size, character_s = sent.reply_size, self.character_s
        deadline_s = sent_end_s + response_time_s + (size or adu.MAX_ADU_SIZE) * character_s
        deadline_s += self._allowance_s
        received = b""
        if size is not None and not (sent.is_mirrored or self._is_echoing):
            read = self._port.read
            received = await read(until_s=deadline_s, count=SHORTEST_REPLY)
            if _HEAD <= len(received) < size and received[:_HEAD] == sent.adu[:_HEAD]:
                received += await read(until_s=deadline_s, count=size - len(received))
            answered = self._plain_answer(sent, received, sent_end_s)
            if answered is not None:
                return answered
        return await self._receive_any(sent, received, sent_end_s, deadline_s, response_time_s)

    def _plain_answer(self, sent: EncodedRequest, frame: bytes, sent_end_s: float) -> Answered | None:
        """Return the answer that these bytes are beyond doubt; None leaves them to the judge."""
        unit = sent.unit
        if len(frame) != sent.reply_size or frame[0] != unit or crc16(frame):
            return None
        pdu = frame[1:-2]
        try:
            value = sent.request.decode_reply(pdu)
        except BadReplyError:
            return None
        if not self._forms.outstanding.believe(unit, pdu):
            return None
        at_s = self._port.last_byte_s
        self._note_frame(at_s, RECEIVED, frame)
        self._bus_faults.note_answer(unit, frame, at_s)
        took_s = max(at_s - len(frame) * self.character_s - sent_end_s, 0.0)
        return Answered(value if sent.cut is None else sent.cut(value), at_s, took_s)

    async def _receive_any(
        self,
        sent: EncodedRequest,
        received: bytes,
        sent_end_s: float,
        deadline_s: float,
        response_time_s: float,
    ) -> Outcome:
        """Wait for the reply among echoes, late replies and noise; part of it is `received`."""
        until_s = deadline_s
        if sent.reply_size is None:
            until_s += (_FIRST_CHUNK_SIZE - adu.MAX_ADU_SIZE) * self.character_s
        reception = Reception(sent, is_echoing=self._is_echoing)
        reception.feed(received)
        foreign: Garbled | None = None
        while True:
            while (frame := reception.take_frame()) is not None:
                outcome = self._judge(sent, frame, len(reception.rest()), sent_end_s)
                if not isinstance(outcome, Garbled):
                    self._is_echoing = reception.has_echo or (self._is_echoing and sent.is_mirrored)
                    self._silence.drop(reception.rest())
                    return outcome
                foreign = outcome
            if self._time() >= until_s:
                break
            chunk = await self._port.read(until_s=until_s, count=reception.lacking())
            if not chunk:
                break
            reception.feed(chunk)
            until_s = min(deadline_s, max(until_s, self._port.last_byte_s + self._gap_s))
        rest = reception.rest()
        self._is_echoing = self._is_echoing or reception.has_echo
        if rest:
            self._note_frame(self._port.last_byte_s, RECEIVED, rest)
            self._bus_faults.note_garbled(sent.unit, len(rest), sent.reply_size, self._time())
            return no_frame(rest)
        self._silence.listen(sent.unit, deadline_s + response_time_s)
        return foreign or Silent()

    def _judge(
        self, sent: EncodedRequest, frame: bytes, behind: int, sent_end_s: float
    ) -> Answered | Refused | Garbled:
        """Return what a whole frame says to this request; Garbled drops it. So many bytes came behind it."""
        at_s = self._port.last_byte_s - behind * self.character_s
        took_s = max(at_s - len(frame) * self.character_s - sent_end_s, 0.0)
        self._note_frame(at_s, RECEIVED, frame)
        reply = adu.Adu(frame[0], frame[1:-2])
        said = judge(sent.unit, sent.request, reply, at_s=at_s, response_time_s=took_s)
        if not isinstance(said, str):
            if isinstance(said, Refused) and said.is_lasting:
                self._forms.give_up(sent, at_s)
            if self._forms.outstanding.believe(sent.unit, reply.pdu):
                self._bus_faults.note_answer(sent.unit, frame, at_s)
                if isinstance(said, Answered) and sent.cut is not None:
                    return replace(said, value=sent.cut(said.value))
                return said
            said = _IN_DOUBT
        self._strays.count += len(frame)
        self._strays.drop(frame)
        return Garbled(said, frame)
