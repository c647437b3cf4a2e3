"""Bytes on a line that nothing waited for: late replies, frames of others, noise.

Whole frames cut the list of their unit (`outstanding.py`, rule 3); all of it are signs for `bus_faults.py`.
While a reply is awaited a frame is judged at once. Bytes at any other time are judged when the line is
quiet, since the rest of a frame may be under way.
"""

from __future__ import annotations

from gateway.line.rtu.bus_faults import BusFaults
from gateway.line.rtu.outstanding import Outstanding
from gateway.line.rtu.reply import frames

_STORED_BYTES = 4096  # what a port stores, so that all late replies in it are seen


class Strays:
    """Bytes that wait to be judged until the line is quiet, and what was recognised in earlier ones."""

    def __init__(self, outstanding: Outstanding, bus_faults: BusFaults) -> None:
        self.count = 0  # bytes
        self.asked = 0  # the unit that was asked last
        self.late_units: list[int] = []  # units of which a listed reply came; the reader clears it
        self._outstanding = outstanding
        self._bus_faults = bus_faults
        self.waiting = bytearray()  # to be judged once the line is quiet

    def take(self, received: bytes) -> None:
        """Count bytes; the last of them are judged later."""
        self.count += len(received)
        self.waiting += received
        del self.waiting[:-_STORED_BYTES]

    def judge(self, now_s: float) -> None:
        """Judge what waits: frames one by one, and what is none."""
        received = bytes(self.waiting)
        self.waiting.clear()
        for piece, is_frame in frames(received):
            if is_frame:
                self.drop(piece, now_s)
            else:
                self._bus_faults.note_noise(len(piece), now_s)

    def drop(self, frame: bytes, now_s: float) -> None:
        """Judge a whole frame that is no answer."""
        unit = frame[0]
        is_listed = self._outstanding.drop(unit, frame[1:-2])
        if is_listed:
            self.late_units.append(unit)
        self._bus_faults.note_frame(frame, asked=self.asked, is_listed=is_listed, now_s=now_s)

    def give_up(self, size: int, now_s: float) -> bytes:
        """Forget what waits, on a line that is never quiet, and return the last of it."""
        tail = bytes(self.waiting[-size:])
        self.waiting.clear()
        self._bus_faults.note_never_quiet(tail, now_s)
        return tail
