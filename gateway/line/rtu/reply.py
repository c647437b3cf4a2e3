"""The bytes received after a request: the frames in them, and their meaning."""

from __future__ import annotations

from collections.abc import Iterator

from gateway.errors import BadFrameError, BadReplyError
from gateway.line.rtu.forms import EncodedRequest
from gateway.line.rtu.transaction import Answered, Garbled, Refused
from gateway.modbus import EXCEPTION_BIT, Request, adu, crc16, exception_code

SHORTEST_REPLY = 5  # bytes: an exception
MOST_STRAY = 2  # bytes before a frame: a driver that is switched on may make them


class Reception:
    """The bytes received after one request, in any chunks.

    Half-duplex adapters may echo what they send. A copy of the request is set aside, save where the reply
    repeats the request; there it counts as the reply unless the line is known to echo (`is_echoing`).
    """

    def __init__(self, sent: EncodedRequest, *, is_echoing: bool) -> None:
        self.has_echo = False
        self._sent = sent
        self._keeps_copy = sent.is_mirrored and not is_echoing
        self._received = bytearray()
        self._is_begun = False  # an echo cannot come any more

    def feed(self, chunk: bytes) -> None:
        """Take the next bytes."""
        self._received += chunk
        if self._is_begun or self._may_be_echo():
            return
        self._is_begun = True
        request = self._sent.adu
        self.has_echo = self._received.startswith(request * 2 if self._keeps_copy else request)
        if self.has_echo:
            del self._received[: len(request)]

    def take_frame(self) -> bytes | None:
        """Take out the first whole frame, with stray bytes before it; None when there is none."""
        if not self._is_begun:
            return None
        stray, frame = first_frame(bytes(self._received))
        del self._received[: stray + len(frame)]
        return frame or None

    def rest(self) -> bytes:
        """Return what is no frame, behind echo and frames."""
        if not self._is_begun and self._received == self._sent.adu:
            self.has_echo = True
            return b""
        return bytes(self._received)

    def lacking(self) -> int:
        """Return how many bytes are missing at least before there may be one more frame."""
        if not self._is_begun:
            return max(SHORTEST_REPLY - len(self._received), 1)
        received = bytes(self._received)
        sizes = [_frame_size(received[stray:]) for stray in range(MOST_STRAY + 1)]
        lacking = [size + stray - len(received) for stray, size in enumerate(sizes) if size]
        return max(min(lacking, default=SHORTEST_REPLY - len(received)), 1)

    def _may_be_echo(self) -> bool:
        return not self._keeps_copy and self._sent.adu.startswith(self._received)


def first_frame(received: bytes) -> tuple[int, bytes]:
    """Return the frame that begins with one of the first three bytes, and at which; none: empty.

    The CRC decides, so that a stray byte before a frame costs nothing.
    """
    for stray in range(MOST_STRAY + 1):
        size = _frame_size(received[stray:])
        frame = received[stray : stray + size]
        if size and len(frame) == size and not crc16(frame):
            return stray, frame
    return 0, b""


def frames(received: bytes) -> Iterator[tuple[bytes, bool]]:
    """Return the frames that these bytes begin with, one by one; then the rest, which is none."""
    while received:
        stray, frame = first_frame(received)
        yield frame or received, bool(frame)
        received = received[stray + len(frame) :] if frame else b""


def judge(
    unit: int, request: Request, by: int, pdu: bytes, *, at_s: float, response_time_s: float
) -> Answered | Refused | str:
    """Return what a PDU that ended at `at_s` says to a request; why nothing, where it is no reply to it."""
    if by != unit:
        return f"reply of unit {by}"
    if pdu[0] & EXCEPTION_BIT and (code := exception_code(request, pdu)) is not None:
        return Refused(code, at_s)
    if pdu[0] & ~EXCEPTION_BIT != request.function:
        return f"reply of function {pdu[0]}"
    try:
        return Answered(request.decode_reply(pdu), at_s, response_time_s)
    except BadReplyError as error:
        return str(error)


def no_frame(received: bytes) -> Garbled:
    """Return the outcome of bytes that are no frame, with the reason."""
    try:
        adu.decode(received)
    except BadFrameError as error:
        return Garbled(str(error), received)
    return Garbled("a frame of another length than it says", received)


def _frame_size(received: bytes) -> int:
    """Return how long the frame is that begins with these bytes; 0 where none does, or it is not known."""
    try:
        return adu.reply_adu_size(received[: adu.MAX_ADU_SIZE]) or 0
    except BadFrameError:
        return 0
