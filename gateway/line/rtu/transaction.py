"""One request and its reply on a port, with the silences that RTU asks for [SERIAL 2.5.1.1]."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from math import inf
from typing import assert_never

from gateway.errors import BadReplyError
from gateway.line.port.base import DeliversLate, HoldsBack, Port
from gateway.line.rtu.bus_faults import BusFaults, whole_frame
from gateway.line.rtu.late_replies import Pace, Quarantine
from gateway.line.rtu.outcome import TOO_LATE, Answered, Garbled, Outcome, Refused, Silent
from gateway.line.rtu.reply import ReplyAssembler, judge
from gateway.line.rtu.request import MIRRORED, EncodedRequest
from gateway.line.rtu.timeouts import ALLOWANCE_S
from gateway.line.rtu.trace import Trace
from gateway.modbus import adu
from gateway.modbus.crc import crc16
from gateway.modbus.pdu import Request
from gateway.modbus.timing import BROADCAST_TURNAROUND_S, LineTiming

BABBLE_LIMIT_S = 1.0  # a line that is busy for longer without our asking is not waited for
STOP_PATIENCE_S = 0.25  # nor, for a stop, one that is busy for longer than this and than the longest frame
LATE_FACTOR = 3.0  # a reply may come so many times later than it is waited for

_FRAME_GAP = 1.5  # characters
_HEAD = 2  # unit and function
_KEPT_STRAY = 256  # bytes; the longest frame
_FIRST_CHUNK_SIZE = 64  # bytes of a reply of unknown length that an adapter may hold back at first


class RtuMaster:
    """Asks one question at a time on an open port; exactly one task uses it."""

    def __init__(
        self,
        port: Port,
        timing: LineTiming,
        *,
        allowance_s: float = ALLOWANCE_S,
        trace: Trace,
        time: Callable[[], float] | None = None,  # the port's clock; None: the running loop's
    ) -> None:
        self._port = port
        self._timing = timing
        self._silence_s = timing.silence_s
        self._character_s = timing.character_s
        self._stop_patience_s = max(STOP_PATIENCE_S, adu.MAX_ADU_SIZE * timing.character_s)
        self._allowance_s = allowance_s
        self._trace = trace
        self._time = time or asyncio.get_running_loop().time
        self._own_end_s = self._time()  # who knows what was on the wire before the port was opened
        self._quarantine = Quarantine()
        self._stray = bytearray()
        self._pace = Pace()
        self._earliest_s = -inf  # the soonest that a reply to the latest request can begin
        self._asked = adu.BROADCAST  # the unit of the latest request
        self._is_echoing = False
        self._began_s = inf  # the first byte of the reply under way
        self.suspicions = BusFaults()
        self.is_on_wire = False  # from the moment a request is written until its outcome is known
        self.written_s = -inf  # when the latest request was written
        self.stray_bytes = 0  # that nobody waited for, since the port was opened

    def reset(self) -> bool:
        """Let nothing that was written reach the wire later; return whether the port is closed for that."""
        if not isinstance(self._port, DeliversLate):
            return False
        self._port.reset()
        return True

    def quiet_from_s(self) -> float:
        """Return when the line will have been silent for long enough, if nothing more comes."""
        return max(self._own_end_s, self._port.last_byte_s) + self._silence_s

    async def hush(self) -> bool:
        """Wait for the silence that must be; False when there is more to wait for, which `settle` does."""
        quiet_s = self.quiet_from_s()
        if self._stray or self._quarantine.until_s() > quiet_s:
            return False
        stray = await self._port.read(until_s=quiet_s)
        self._drop(stray)
        return not stray

    async def settle(
        self, unit: int | None = None, *, is_for_stop: Callable[[], bool] = lambda: False
    ) -> Garbled | None:
        """Wait until a request may be sent (to this unit): the line is silent, late replies are gone.

        Returns None when it may; Garbled when the line does not become quiet within about a second, or within
        a stop's patience as soon as it is for one.
        """
        began_s = max(self._time(), self._quarantine.until_s(unit))
        while True:
            quiet_s = self.quiet_from_s()
            if self._stray and self._time() >= quiet_s:
                self._judge_stray(bytes(self._stray))
                self._stray.clear()
            due_s = quiet_s if self._stray else max(quiet_s, self._quarantine.until_s(unit))
            chunk = await self._port.read(until_s=due_s)
            now_s = self._time()
            if chunk:
                self._drop(chunk)
            elif not self._stray and now_s >= max(self.quiet_from_s(), self._quarantine.until_s(unit)):
                return None
            limit_s = self._stop_patience_s if is_for_stop() else BABBLE_LIMIT_S
            if now_s >= began_s + limit_s and now_s < self.quiet_from_s():
                tail = bytes(self._stray)
                self._stray.clear()
                self.suspicions.note_never_quiet(tail, now_s=now_s)
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
        return await self.exchange(EncodedRequest.of(unit, request), response_time_s=response_time_s)

    async def exchange(
        self,
        prepared: EncodedRequest,
        *,
        response_time_s: float,
        longest_s: float | None = None,
        until_s: float = inf,
        meanwhile: Callable[[], None] | None = None,
    ) -> Outcome:
        """Send a request now, the line being settled, and return what became of it by its deadline.

        `longest_s` is the response time that late replies are reckoned by, when `response_time_s` was cut
        short; `meanwhile` is done once the request is on its way. After `until_s` nothing is sent: that is
        looked at last of all, since the process may be stopped at any moment before. Raises as `transact`.
        """
        if until_s < inf and self._is_past(until_s):
            return Silent(TOO_LATE, is_sent=False)
        self.is_on_wire = True
        wire_s = len(prepared.adu) * self._character_s
        self._earliest_s = self._time() + wire_s
        self._port.write(prepared.adu)
        self.written_s = self._time()
        self._own_end_s = self.written_s + wire_s
        self._asked = prepared.unit
        self.suspicions.note_asked(prepared.unit)
        self._pace.note_asked(prepared.unit)
        self._trace.sent(self.written_s, prepared.adu)
        if meanwhile is not None:
            meanwhile()
        if prepared.unit == adu.BROADCAST:
            outcome = await self._turn_around()
        else:
            outcome = await self._hear(prepared, response_time_s, max(longest_s or 0.0, response_time_s))
        self.is_on_wire = False
        return outcome

    def _is_past(self, until_s: float) -> bool:
        """Return whether a frame that is written now would be late."""
        if isinstance(self._port, HoldsBack):
            self._port.hold()
        return self._time() > until_s

    async def _hear(self, prepared: EncodedRequest, response_time_s: float, longest_s: float) -> Outcome:
        """Wait for the reply; judge it when it is whole, or whatever there is at the deadline."""
        sent_end_s = self._own_end_s
        reply_s = (prepared.reply_size or adu.MAX_ADU_SIZE) * self._character_s
        deadline_s = sent_end_s + response_time_s + reply_s + self._allowance_s
        heard = b""
        if prepared.reply_size is not None and not (prepared.is_mirrored or self._is_echoing):
            heard = await self._expect(prepared, prepared.reply_size, deadline_s)
            answered = self._plain_answer(prepared, heard, sent_end_s)
            if answered is not None:
                return answered
        first_by_s = deadline_s
        if prepared.reply_size is None:
            first_by_s += _FIRST_CHUNK_SIZE * self._character_s - reply_s
        hearing = ReplyAssembler(prepared.adu, is_mirrored=prepared.is_mirrored, is_echoing=self._is_echoing)
        await self._listen(hearing, heard, first_by_s=first_by_s, deadline_s=deadline_s)
        at_s = self._port.last_byte_s
        if hearing.received:
            self._trace.received(at_s, hearing.received)
        outcome = self._judge(prepared, hearing, at_s=at_s, took_s=max(self._began_s - sent_end_s, 0.0))
        if isinstance(outcome, Answered | Refused) and not self.suspicions.is_doubling(prepared.unit):
            self._quarantine.end(prepared.unit)
            return outcome
        late_s = longest_s - response_time_s + deadline_s - sent_end_s
        unit_until_s = sent_end_s + LATE_FACTOR * late_s + reply_s + self._allowance_s
        self._guard(prepared.unit, outcome, deadline_s, deadline_s + response_time_s, unit_until_s)
        return outcome

    async def _expect(self, prepared: EncodedRequest, size: int, until_s: float) -> bytes:
        """Return what is heard as soon as it has the size of the normal reply, or cannot become one."""
        heard = await self._port.read(until_s=until_s, count=_HEAD)
        self._began_s = self._port.last_byte_s - len(heard) * self._character_s
        while _HEAD <= len(heard) < size and heard[:_HEAD] == prepared.adu[:_HEAD]:
            more = await self._port.read(until_s=until_s, count=size - len(heard))
            if not more:
                break
            heard += more
        return heard

    def _plain_answer(self, prepared: EncodedRequest, frame: bytes, sent_end_s: float) -> Answered | None:
        """Return the answer that a frame is beyond doubt, as nearly all are; None leaves it to the judge."""
        if len(frame) != prepared.reply_size or frame[0] != prepared.unit or crc16(frame):
            return None
        unit = prepared.unit
        if self._quarantine.owes(unit) or self.suspicions.is_doubling(unit) or self._is_too_soon(unit, frame):
            return None
        try:
            value = prepared.request.decode_reply(frame[1:-2])
        except BadReplyError:
            return None
        at_s = self._port.last_byte_s
        self._trace.received(at_s, frame)
        self.suspicions.note_answer(unit, frame, at_s=at_s)
        return Answered(value, at_s, max(self._began_s - sent_end_s, 0.0))

    def _judge(
        self, prepared: EncodedRequest, hearing: ReplyAssembler, *, at_s: float, took_s: float
    ) -> Outcome:
        """Return what was heard, and take note of what else was."""
        whole = hearing.whole_reply()
        reply = hearing.reply()
        frame = reply if whole is None else whole
        if hearing.has_echo:
            self._is_echoing = True
        if not frame:
            return Silent()
        outcome = judge(frame, prepared.unit, prepared.request, at_s=at_s, response_time_s=took_s)
        if not isinstance(outcome, Garbled) and self._is_too_soon(prepared.unit, frame):
            outcome = Garbled("it began before the request was over", frame)
        if isinstance(outcome, Answered) and not (prepared.is_mirrored or hearing.has_echo):
            self._is_echoing = False
        if isinstance(outcome, Garbled):
            self.suspicions.note_garbled(
                prepared.unit,
                reply,
                reply_size=prepared.reply_size,
                owes=self._quarantine.owes,
                now_s=self._time(),
            )
        else:
            self.suspicions.note_answer(prepared.unit, frame, at_s=at_s)
        if len(reply) > len(frame):
            self.stray_bytes += len(reply) - len(frame)
            if not isinstance(outcome, Garbled):
                self._judge_stray(reply[len(frame) :])
        return outcome

    async def _listen(
        self, hearing: ReplyAssembler, heard: bytes, *, first_by_s: float, deadline_s: float
    ) -> None:
        """Read on until the reply is whole or will not come, and note when its first byte began.

        Where the first byte is due before the deadline, only further bytes keep us listening so long.
        """
        gap_s = self._silence_s + self._allowance_s
        hearing.feed(heard)
        if not heard or hearing.may_be_echo():
            self._began_s = inf
        elif hearing.has_echo:
            self._began_s = self._port.last_byte_s - len(hearing.reply()) * self._character_s
        until_s = first_by_s
        while self._time() < until_s and hearing.whole_reply() is None:
            chunk = await self._port.read(until_s=until_s, count=hearing.lacking())
            if chunk:
                hearing.feed(chunk)
                last_byte_s = self._port.last_byte_s
                until_s = min(deadline_s, max(until_s, last_byte_s + gap_s))
                if self._began_s == inf and not hearing.may_be_echo():
                    self._began_s = last_byte_s - len(hearing.reply()) * self._character_s

    async def _turn_around(self) -> Outcome:
        """Give every unit the time to act on a broadcast; none answers [SERIAL 2.4.1]."""
        end_s = self._own_end_s + BROADCAST_TURNAROUND_S
        while self._time() < end_s:
            self._drop(await self._port.read(until_s=end_s))
        return Silent("broadcast")

    def _guard(
        self, unit: int, outcome: Outcome, deadline_s: float, line_until_s: float, unit_until_s: float
    ) -> None:
        """See to it that a reply that may still come is not taken for the next answer."""
        match outcome:
            case Answered() | Refused():  # of a unit whose requests are answered twice
                self._quarantine.hold(unit, unit_until_s)
            case Garbled(received=frame) if self._is_own_reply(frame):
                self._quarantine.begin(unit, line_until_s=deadline_s, unit_until_s=deadline_s)
            case Silent() | Garbled():
                self._quarantine.begin(unit, line_until_s=line_until_s, unit_until_s=unit_until_s)
            case _:
                assert_never(outcome)

    def _is_own_reply(self, garbled: bytes) -> bool:
        """Return whether this can only be the reply itself, spoilt: no frame, and nobody is late."""
        return not (self._quarantine.heard(garbled) or self._quarantine.is_anyone_late(self._own_end_s))

    def _is_too_soon(self, unit: int, frame: bytes) -> bool:
        """Return whether a right reply answers an earlier request: it began before this one was over."""
        reply_s = len(frame) * self._character_s
        return self._pace.is_too_soon(unit, early_s=self._earliest_s - self._began_s, reply_s=reply_s)

    def _judge_stray(self, stray: bytes) -> None:
        """Find out who said what nobody waited for."""
        frame = whole_frame(stray)
        if frame is not None:
            self._pace.note_stray(frame.unit)
        self.suspicions.note_stray(stray, asked=self._asked, owes=self._quarantine.owes, now_s=self._time())
        self._quarantine.heard(stray)

    def _drop(self, stray: bytes) -> None:
        """Count and forget bytes that nobody waited for; the last of them stay for the quarantine."""
        if stray:
            self.stray_bytes += len(stray)
            self._trace.strayed(self._port.last_byte_s, stray)
            self._stray += stray
            del self._stray[:-_KEPT_STRAY]
