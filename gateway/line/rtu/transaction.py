"""One request and its reply on a port, with the silences that RTU asks for [SERIAL 2.5.1.1]."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from math import inf

from gateway.errors import BadReplyError
from gateway.line.port.base import DeliversLate, HoldsBack, Port
from gateway.line.rtu.bus_faults import BusFaults, whole_frame
from gateway.line.rtu.late_replies import Agreed, LateReplies, Shape
from gateway.line.rtu.outcome import TOO_LATE, Answered, Garbled, Outcome, Refused, Silent
from gateway.line.rtu.reply import ReplyAssembler, judge, pieces
from gateway.line.rtu.reply_times import ALLOWANCE_S, Pace
from gateway.line.rtu.request import EncodedRequest, Forms
from gateway.modbus import adu
from gateway.modbus.adu import crc16
from gateway.modbus.codes import EXCEPTION_BIT, Function
from gateway.modbus.pdu import Request
from gateway.modbus.timing import BROADCAST_TURNAROUND_S, LineTiming

BABBLE_LIMIT_S = 1.0  # a line that is busy for longer without our asking is not waited for
STOP_PATIENCE_S = 0.25  # nor, for a stop, one that is busy for longer than this and than the longest frame

SENT, RECEIVED, STRAY = ">>", "<<", "??"  # where a frame goes; what was not waited for is a stray

_FRAME_GAP = 1.5  # characters
_HEAD = 2  # unit and function
_STRAY_BYTES = 4096  # bytes; what a port keeps, so that all late replies in it are seen
_FIRST_CHUNK_SIZE = 64  # bytes of a reply of unknown length that an adapter may hold back at first


class RtuMaster:
    """Asks one question at a time on an open port; exactly one task uses it."""

    def __init__(
        self,
        port: Port,
        timing: LineTiming,
        *,
        allowance_s: float = ALLOWANCE_S,
        note_frame: Callable[[float, str, bytes], None],  # when, which way, and what was on the wire
        forms: Forms | None = None,  # those of this line, if a port was open before
        time: Callable[[], float] | None = None,  # the port's clock; None: the running loop's
    ) -> None:
        self._port = port
        self._timing = timing
        self._silence_s = timing.silence_s
        self.character_s = self._character_s = timing.character_s
        self._stop_patience_s = max(STOP_PATIENCE_S, adu.MAX_ADU_SIZE * timing.character_s)
        self._allowance_s = allowance_s
        self._note_frame = note_frame
        self._time = time or asyncio.get_running_loop().time
        self._own_end_s = self._time()  # who knows what was on the wire before the port was opened
        self.forms = forms or Forms(LateReplies())
        self.late = self.forms.late
        self._line_until_s = -inf  # no request before, so that a reply just too late can end
        self._line_unit = adu.BROADCAST  # the unit that is waited for
        self._may_be_older = False  # the acknowledgement of the write under way:
        self._acknowledges_since_s = inf  # it is of one that was written then or later
        self._awaited: Shape | None = None  # of the reply to the latest request, until it has come
        self._stray = bytearray()
        self._pace = Pace()
        self._earliest_s = -inf  # the soonest that a reply to the latest request can begin
        self._asked = adu.BROADCAST  # the unit of the latest request
        self._is_echoing = False
        self._began_s = inf  # the first byte of the reply under way
        self.bus_faults = BusFaults()
        self.is_on_wire = False  # from the moment a request is written until its outcome is known
        self.written_s = -inf  # when the latest request was written
        self.stray_bytes = 0  # that were not waited for, since the port was opened

    def reset(self) -> bool:
        """Let nothing that was written reach the wire later; return whether the port is closed for that."""
        if not isinstance(self._port, DeliversLate):
            return False
        self._port.reset()
        return True

    def quiet_from_s(self) -> float:
        """Return when the line will have been silent for long enough, if nothing more comes."""
        return max(self._own_end_s, self._port.last_byte_s) + self._silence_s

    async def hush(self, quiet_s: float) -> bool:
        """Wait for the silence until then; False when there is more to wait for, which `settle` does."""
        if self._stray or self._line_until_s > quiet_s:
            return False
        stray = await self._port.read(until_s=quiet_s)
        if stray:
            self._drop(stray)
        return not stray

    async def settle(
        self, until_s: float = -inf, *, is_for_stop: Callable[[], bool] = lambda: False
    ) -> Garbled | None:
        """Wait until a request may be sent, and not before `until_s`: the line is silent.

        Returns None when it may; Garbled when the line does not become quiet within about a second, or within
        a stop's patience as soon as it is for one.
        """
        began_s = max(self._time(), self._line_until_s, until_s)
        while True:
            quiet_s = self.quiet_from_s()
            if self._stray and self._time() >= quiet_s:
                self._judge_strays(bytes(self._stray))
                self._stray.clear()
            due_s = quiet_s if self._stray else max(quiet_s, self._line_until_s, until_s)
            chunk = await self._port.read(until_s=due_s)
            now_s = self._time()
            if chunk:
                self._drop(chunk)
            elif not self._stray and now_s >= max(self.quiet_from_s(), self._line_until_s, until_s):
                return None
            limit_s = self._stop_patience_s if is_for_stop() else BABBLE_LIMIT_S
            if now_s >= began_s + limit_s and now_s < self.quiet_from_s():
                tail = bytes(self._stray[-adu.MAX_ADU_SIZE :])
                self._stray.clear()
                self.bus_faults.note_never_quiet(tail, now_s=now_s)
                return Garbled("the line is never quiet", tail, is_sent=False)

    async def find_gap(self, within_s: float) -> None:
        """Wait for the end of a frame, but no longer than this, on a line that is never quiet.

        Inside a frame no pause is longer than 1.5 characters [SERIAL 2.5.1.1].
        """
        until_s = self._time() + within_s
        while (now_s := self._time()) < until_s:
            gap_s = max(self._own_end_s, self._port.last_byte_s) + _FRAME_GAP * self._character_s
            if now_s >= gap_s:
                return
            self._drop(await self._port.read(until_s=min(gap_s, until_s)))

    async def transact(self, unit: int, request: Request, *, response_time_s: float) -> Outcome:
        """Send a request as soon as the line allows, and return what became of it by its deadline.

        Raises PortLostError; `is_on_wire` then says whether the request may have been sent.
        """
        encoded = EncodedRequest.of(unit, request)
        until_s = -inf
        while True:
            noise = await self.settle(until_s)
            if noise is not None:
                return noise
            form = self.forms.choose(encoded, lambda _: (), self._time())
            if form is not None:
                outcome = await self.exchange(form, response_time_s=response_time_s)
                if (
                    form.times == 1
                    or not isinstance(outcome, Answered)
                    or self.agrees(form, outcome) is Agreed.YES
                ):
                    return outcome
            until_s = self.late.free_from_s(unit, request, self._time())

    def agrees(self, form: EncodedRequest, outcome: Answered) -> Agreed:
        """Return whether this answer of a series counts, as enough before it said the same."""
        return self.late.agree(
            form.unit, form.asked, form.shape, outcome.value, self._time(), times=form.times
        )

    async def exchange(
        self,
        encoded: EncodedRequest,
        *,
        response_time_s: float,
        until_s: float = inf,
        meanwhile: Callable[[], None] | None = None,
    ) -> Outcome:
        """Send a request now, the line being settled, and return what became of it by its deadline.

        `meanwhile` is done once the request is on its way. After `until_s` nothing is sent: that is looked at
        last of all, since the process may be stopped at any moment before. Raises as `transact`.
        """
        if until_s < inf and self._is_past(until_s):
            return Silent(TOO_LATE, is_sent=False)
        self.is_on_wire = True
        wire_s = len(encoded.adu) * self._character_s
        self._earliest_s = self._time() + wire_s
        self._port.write(encoded.adu)
        self.written_s = self._time()
        self._own_end_s = self.written_s + wire_s
        self._asked = encoded.unit
        self.bus_faults.note_asked(encoded.unit)
        self._pace.note_asked(encoded.unit)
        self._note_frame(self.written_s, SENT, encoded.adu)
        try:
            if meanwhile is not None:
                meanwhile()
            if encoded.unit == adu.BROADCAST:
                outcome = await self._await_turnaround()
            else:
                self._expect_shape(encoded)
                outcome = await self._receive(encoded, response_time_s)
        finally:
            if self._awaited is not None:
                self.late.note_unanswered(
                    encoded.unit, self._awaited, self.written_s, self._time(), encoded.request
                )
                self._awaited = None
        self.is_on_wire = False
        if encoded.cut is None:
            return outcome
        if isinstance(outcome, Refused) and outcome.is_lasting:
            self.forms.give_up(encoded)
        return (
            replace(outcome, value=encoded.cut(outcome.value)) if isinstance(outcome, Answered) else outcome
        )

    def _expect_shape(self, encoded: EncodedRequest) -> None:
        """Await a reply of this request's shape from now on."""
        self._awaited = encoded.shape
        self.late.note_sent(encoded.unit, encoded.asked, encoded.shape)
        if encoded.request.is_write:
            self._acknowledges_since_s = self.late.acknowledges_since_s(
                encoded.unit, encoded.request, encoded.shape, self.written_s
            )
        self._may_be_older = encoded.request.is_write and self._acknowledges_since_s < self.written_s

    def _is_past(self, until_s: float) -> bool:
        """Return whether a frame that is written now would be late."""
        if isinstance(self._port, HoldsBack):
            self._port.hold()
        return self._time() > until_s

    async def _receive(self, encoded: EncodedRequest, response_time_s: float) -> Outcome:
        """Wait for the reply; judge it when it is whole, or whatever there is at the deadline.

        Nearly all come as they should: those are read here, up to the size of the normal reply.
        """
        size, character_s = encoded.reply_size, self._character_s
        deadline_s = self._own_end_s + response_time_s + (size or adu.MAX_ADU_SIZE) * character_s
        deadline_s += self._allowance_s
        received = b""
        self._began_s = inf
        if size is not None and not (encoded.is_mirrored or self._is_echoing):
            read = self._port.read
            received = await read(until_s=deadline_s, count=_HEAD)
            self._began_s = self._port.last_byte_s - len(received) * character_s
            while _HEAD <= len(received) < size and received[:_HEAD] == encoded.adu[:_HEAD]:
                more = await read(until_s=deadline_s, count=size - len(received))
                if not more:
                    break
                received += more
            answered = self._plain_answer(encoded, received, self._own_end_s)
            if answered is not None:
                return answered
        return await self._receive_any(encoded, received, response_time_s, deadline_s)

    async def _receive_any(
        self, encoded: EncodedRequest, received: bytes, response_time_s: float, deadline_s: float
    ) -> Outcome:
        """Wait for a reply of any form among echoes and other frames; part of it is `received`."""
        first_by_s = deadline_s
        if encoded.reply_size is None:
            first_by_s += (_FIRST_CHUNK_SIZE - adu.MAX_ADU_SIZE) * self._character_s
        sent_end_s = self._own_end_s
        assembler = ReplyAssembler(encoded.adu, is_mirrored=encoded.is_mirrored, is_echoing=self._is_echoing)
        assembler.feed(received)
        foreign: Outcome | None = None
        began_s = self._began_s  # of the first frame, at the latest
        while True:
            await self._listen(assembler, first_by_s=first_by_s, deadline_s=deadline_s)
            began_s = min(began_s, self._began_s)
            frame, outcome = self._judge(encoded, assembler, sent_end_s=sent_end_s)
            if isinstance(outcome, Answered | Refused):
                if foreign is not None:
                    self._pace.note_stray(encoded.unit)
                return outcome
            whole = whole_frame(frame)
            if whole is None:
                break
            self._set_aside(encoded, whole, frame, began_s)
            assembler.skip(len(frame))
            began_s = inf
            foreign = outcome
        if isinstance(outcome, Silent) and foreign is not None:
            outcome = foreign
        self._line_unit, self._line_until_s = encoded.unit, deadline_s + response_time_s
        if isinstance(outcome, Garbled) and foreign is None and self._is_own_reply(encoded, outcome):
            self._line_until_s = deadline_s
            self._awaited = None
        return outcome

    def _plain_answer(self, encoded: EncodedRequest, frame: bytes, sent_end_s: float) -> Answered | None:
        """Return the answer that a frame is beyond doubt, as nearly all are; None leaves it to the judge."""
        if len(frame) != encoded.reply_size or frame[0] != encoded.unit or crc16(frame):
            return None
        unit = encoded.unit
        early_s, reply_s = self._earliest_s - self._began_s, len(frame) * self._character_s
        if self._may_be_older or self._pace.is_too_soon(unit, early_s=early_s, reply_s=reply_s):
            return None
        try:
            value = encoded.request.decode_reply(frame[1:-2])
        except BadReplyError:
            return None
        at_s = self._port.last_byte_s
        self._note_frame(at_s, RECEIVED, frame)
        self._note_answer(encoded, frame, at_s)
        return Answered(value, at_s, max(self._began_s - sent_end_s, 0.0))

    def _judge(
        self, encoded: EncodedRequest, assembler: ReplyAssembler, *, sent_end_s: float
    ) -> tuple[bytes, Outcome]:
        """Return the first frame received, or whatever there is, and what it says to this request."""
        whole = assembler.whole_reply()
        reply = assembler.reply()
        frame = reply if whole is None else whole
        at_s = self._port.last_byte_s
        if assembler.has_echo:
            self._is_echoing = True
        if assembler.received:
            self._note_frame(at_s, RECEIVED, assembler.received)
        if not frame:
            return frame, Silent()
        took_s = max(self._began_s - sent_end_s, 0.0)
        outcome = judge(frame, encoded.unit, encoded.request, at_s=at_s, response_time_s=took_s)
        if not isinstance(outcome, Garbled):
            outcome = self._doubt(encoded, frame) or outcome
        if isinstance(outcome, Answered) and not (encoded.is_mirrored or assembler.has_echo):
            self._is_echoing = False
        if isinstance(outcome, Garbled):
            received = reply if whole_frame(frame) is None else frame
            self.bus_faults.note_garbled(
                encoded.unit,
                received,
                reply_size=encoded.reply_size,
                owes=self.late.owes,
                now_s=self._time(),
            )
        else:
            self._note_answer(encoded, frame, at_s)
            if len(reply) > len(frame):
                self.stray_bytes += len(reply) - len(frame)
                self._judge_strays(reply[len(frame) :])
        return frame, outcome

    def _doubt(self, encoded: EncodedRequest, frame: bytes) -> Garbled | None:
        """Return why a right frame may answer an earlier request; None when it cannot."""
        unit, function = encoded.unit, encoded.request.function
        early_s, reply_s = self._earliest_s - self._began_s, len(frame) * self._character_s
        if self._pace.is_too_soon(unit, early_s=early_s, reply_s=reply_s):
            return Garbled("it began before the request was over", frame)
        if frame[1] & EXCEPTION_BIT:
            literal = encoded.request if encoded.is_literal else None
            is_sure = self.late.is_refusal_sure(unit, function, self._time(), literal=literal)
            if is_sure and not self._may_be_older:
                return None
            if encoded.request.is_write or encoded.is_literal:
                pass  # its read-back decides; who asks literally asks again
            elif encoded.cut is None:
                self.late.note_refusal_doubted(unit, encoded.asked)
            else:
                self.forms.give_up(encoded)
            return Garbled("it may be the refusal of an earlier request", frame)
        if self._may_be_older and function != Function.READ_WRITE_REGISTERS:
            since_s = self._acknowledges_since_s
            return Garbled(
                "it may be the acknowledgement of an earlier write", frame, acknowledges_since_s=since_s
            )
        return None

    def _set_aside(self, encoded: EncodedRequest, frame: adu.Adu, received: bytes, began_s: float) -> None:
        """Take note of a whole frame that is not the answer, while that is still awaited."""
        self.stray_bytes += len(received)
        awaited = encoded.shape if frame.unit == encoded.unit else None
        self.late.note_stray(
            frame.unit,
            frame.pdu,
            began_s=min(self.written_s, began_s),  # the earliest: it may be older than this request
            at_s=self._port.last_byte_s,
            awaited=awaited,
        )

    def _note_answer(self, encoded: EncodedRequest, frame: bytes, at_s: float) -> None:
        """Take note of the answer."""
        self.bus_faults.note_answer(encoded.unit, frame, at_s=at_s)
        self._awaited = None
        self.late.note_answer(
            encoded.unit,
            encoded.request,
            encoded.asked,
            frame[1:-2],
            at_s,
            began_s=self._began_s,
            is_sure=encoded.times == 1,
        )

    async def _listen(self, assembler: ReplyAssembler, *, first_by_s: float, deadline_s: float) -> None:
        """Read on until the reply is whole or will not come, and note when its first byte began.

        Where the first byte is due before the deadline, only further bytes keep us listening so long.
        """
        gap_s = self._silence_s + self._allowance_s
        self._began_s = inf
        if assembler.received and not assembler.may_be_echo():
            self._began_s = self._port.last_byte_s - len(assembler.reply()) * self._character_s
        until_s = first_by_s
        while self._time() < until_s and assembler.whole_reply() is None:
            chunk = await self._port.read(until_s=until_s, count=assembler.lacking())
            if chunk:
                assembler.feed(chunk)
                last_byte_s = self._port.last_byte_s
                until_s = min(deadline_s, max(until_s, last_byte_s + gap_s))
                if self._began_s == inf and not assembler.may_be_echo():
                    self._began_s = last_byte_s - len(assembler.reply()) * self._character_s

    async def _await_turnaround(self) -> Outcome:
        """Give every unit the time to act on a broadcast; none answers [SERIAL 2.4.1]."""
        end_s = self._own_end_s + BROADCAST_TURNAROUND_S
        while self._time() < end_s:
            self._drop(await self._port.read(until_s=end_s))
        return Silent("broadcast")

    def _is_own_reply(self, encoded: EncodedRequest, garbled: Garbled) -> bool:
        """Return whether this can only be the reply itself, damaged: no reply is late, or it is as long."""
        now_s = self._own_end_s
        is_alone = not self.late.is_anyone_late(now_s)
        return is_alone or len(garbled.received) == encoded.reply_size

    def _judge_strays(self, stray: bytes) -> None:
        """Find out who sent what was not waited for; several frames may have come at once."""
        for piece in pieces(stray):
            frame = whole_frame(piece)
            if frame is not None:
                self._pace.note_stray(frame.unit)
            self.bus_faults.note_stray(piece, asked=self._asked, owes=self.late.owes, now_s=self._time())
            if frame is not None:
                at_s = self._port.last_byte_s
                began_s = at_s - len(stray) * self._character_s
                self.late.note_stray(frame.unit, frame.pdu, began_s=began_s, at_s=at_s)
                if frame.unit == self._line_unit:
                    self._line_until_s = -inf

    def _drop(self, stray: bytes) -> None:
        """Count and forget bytes that were not waited for; the last of them are judged once it is quiet."""
        if stray:
            self.stray_bytes += len(stray)
            self._note_frame(self._port.last_byte_s, STRAY, stray)
            self._stray += stray
            del self._stray[:-_STRAY_BYTES]
