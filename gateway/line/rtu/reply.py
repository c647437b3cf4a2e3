"""What was received after a request: where the reply is in it, what it says, whether it came too soon."""

from __future__ import annotations

from collections.abc import Iterator

from gateway.errors import BadFrameError, BadReplyError
from gateway.line.rtu.bus_faults import whole_frame
from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Refused
from gateway.modbus import adu
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.pdu import Request, exception_code

SHORTEST_REPLY = 5  # bytes: an exception
TIMELY_ENOUGH = 3  # replies in a row that took their time, before one that did not is doubted
DOUBTS_ENOUGH = 5  # of the same reply in a row, and no other followed: here bytes need not take their time

_TOLERANCE_S = 0.0005
_CLOCKS = 0.03  # by so much a starter's bits may be shorter than ours


class ReplyAssembler:
    """The bytes received after one request, in any chunks.

    Half-duplex adapters may echo what they send. A copy of the request is set aside, save where the reply
    repeats the request; there it counts as the reply unless the line is known to echo (`is_echoing`).
    """

    def __init__(self, request_adu: bytes, *, is_mirrored: bool, is_echoing: bool) -> None:
        self._request_adu = request_adu
        self._keeps_copy = is_mirrored and not is_echoing
        self._received = bytearray()

    @property
    def received(self) -> bytes:
        """Everything received so far."""
        return bytes(self._received)

    def feed(self, chunk: bytes) -> None:
        """Take the next bytes."""
        self._received += chunk

    @property
    def has_echo(self) -> bool:
        """Whether it began with an echo of the request, as far as that can be known."""
        start = self._request_adu * 2 if self._keeps_copy else self._request_adu
        return self._received.startswith(start)

    def reply(self) -> bytes:
        """Return what was received after the echo, if there was one."""
        is_echo = self._received.startswith(self._request_adu) and not self._keeps_copy
        return bytes(self._received[len(self._request_adu) :] if is_echo else self._received)

    def skip(self, size: int) -> None:
        """Leave out the first so many bytes of what was received after the echo."""
        start = len(self._received) - len(self.reply())
        del self._received[start : start + size]

    def may_be_echo(self) -> bool:
        """Return whether all of it, if anything, may be (part of) an echo."""
        return not self._keeps_copy and self._request_adu.startswith(self._received)

    def lacking(self) -> int:
        """Return how many bytes are missing at least before more can be said than now."""
        received = self._received
        if len(received) < SHORTEST_REPLY:
            return SHORTEST_REPLY - len(received)
        if self.may_be_echo():
            return 1
        reply = self.reply()
        try:
            size = adu.reply_adu_size(reply)
        except BadFrameError:
            return 1
        return 1 if size is None else max(size - len(reply), 1)

    def whole_reply(self) -> bytes | None:
        """Return the frame as soon as it is whole, or can be none; bytes behind its end are left out."""
        if self.may_be_echo():
            return None
        reply = self.reply()
        try:
            size = adu.reply_adu_size(reply)
        except BadFrameError:
            return reply
        return reply[:size] if size is not None and len(reply) >= size else None


def judge(frame: bytes, unit: int, request: Request, *, at_s: float, response_time_s: float) -> Outcome:
    """Return what a frame that ended at `at_s` says to this request: CRC, unit, function, length, echo."""
    try:
        reply = adu.decode(frame)
    except BadFrameError as error:
        return Garbled(str(error), frame)
    if reply.unit != unit:
        return Garbled(f"reply of unit {reply.unit}", frame)
    code = exception_code(request, reply.pdu)
    if code is not None:
        return Refused(code, at_s)
    if reply.pdu[0] & ~EXCEPTION_BIT != request.function:
        return Garbled(f"reply of function {reply.pdu[0]}", frame)
    try:
        value = request.decode_reply(reply.pdu)
    except BadReplyError as error:
        return Garbled(str(error), frame)
    return Answered(value, at_s, response_time_s)


def pieces(stray: bytes) -> Iterator[bytes]:
    """Return the frames that these bytes begin with, one by one; then the rest as it is."""
    while stray:
        try:
            size = adu.reply_adu_size(stray[: adu.MAX_ADU_SIZE])
        except BadFrameError:
            size = None
        if size is None or whole_frame(stray[:size]) is None:
            size = len(stray)
        yield stray[:size]
        stray = stray[size:]


class Pace:
    """Whether bytes take their time on a port, so that no reply begins before its request is over.

    On a true line they do: a frame that began sooner is a copy of, or the late answer to, an earlier request.
    On a pseudo terminal or behind a network they need not, and nothing follows from when they come.
    """

    def __init__(self) -> None:
        self._timely = 0
        self._is_known_not_to = False
        self._doubts: dict[tuple[int, float], int] = {}  # in a row, by unit and length
        self._doubted: tuple[int, float] | None = None  # the latest, until it shows whether we were right

    def is_too_soon(self, unit: int, *, early_s: float, reply_s: float) -> bool:
        """Return whether a reply of this length cannot be the answer: it began `early_s` before it might."""
        if self._is_known_not_to:
            return False
        if early_s <= _TOLERANCE_S + _CLOCKS * reply_s:
            self._timely += 1
            if self._doubts:
                self._doubts.pop((unit, reply_s), None)
            return False
        if self._timely < TIMELY_ENOUGH:
            self._timely = 0
            return False
        self._doubted = (unit, reply_s)
        return True

    def note_stray(self, unit: int) -> None:
        """Record that a unit sent one more frame: it was right to doubt the one before."""
        if self._doubted is not None and self._doubted[0] == unit:
            self._doubts.pop(self._doubted, None)
            self._doubted = None

    def note_asked(self, unit: int) -> None:
        """Record that a unit is asked: had it sent one more frame, that would have come by now."""
        if self._doubted is not None and self._doubted[0] == unit:
            doubts = self._doubts[self._doubted] = self._doubts.get(self._doubted, 0) + 1
            self._is_known_not_to = doubts >= DOUBTS_ENOUGH
            self._doubted = None
