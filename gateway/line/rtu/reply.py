"""What was received after a request: where the reply is in it, and what it says."""

from __future__ import annotations

from collections.abc import Iterator

from gateway.errors import BadFrameError, BadReplyError
from gateway.line.rtu.bus_faults import whole_frame
from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Refused
from gateway.modbus import adu
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.pdu import Request, exception_code

SHORTEST_REPLY = 5  # bytes: an exception
MOST_STRAY = 2  # bytes before a reply: a driver that is switched on may make them
_HEAD = 2  # unit and function


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
        """Return the frame as soon as it is whole, or can be none; bytes behind its end are left out.

        Up to `MOST_STRAY` bytes before a reply are left out where its CRC is right without them.
        """
        if self.may_be_echo() or len(self.reply()) < MOST_STRAY + _HEAD:
            return None
        if self._begins_behind_stray():
            return None
        reply = self.reply()
        try:
            size = adu.reply_adu_size(reply)
        except BadFrameError:
            return reply
        return reply[:size] if size is not None and len(reply) >= size else None

    def _begins_behind_stray(self) -> bool:
        """Leave out stray bytes before a whole reply; return whether one that is not whole may follow."""
        for stray in range(MOST_STRAY + 1):
            behind = self.reply()[stray:]
            if self._is_head(behind):
                try:
                    size = adu.reply_adu_size(behind)
                except BadFrameError:
                    continue
                if stray == 0:
                    return False
                if size is None or len(behind) < size:
                    return True
                if whole_frame(behind[:size]) is not None:
                    self.skip(stray)
                    return False
        return False

    def _is_head(self, received: bytes) -> bool:
        """Return whether this begins with unit and function of the request, or of its refusal."""
        return (received[0], received[1] & ~EXCEPTION_BIT) == (self._request_adu[0], self._request_adu[1])


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
