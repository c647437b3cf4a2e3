"""Whether bytes take their time on a line, so that no reply begins before its request is over; pure.

On a true line they do: a frame that began sooner is a copy of, or the late answer to, an earlier request.
On a pseudo terminal or behind a network they need not, and nothing follows from when they come.
"""

from __future__ import annotations

KEPT_ENOUGH = 3  # replies in a row that took their time, before one that did not is doubted
DOUBTS_ENOUGH = 5  # of the same reply in a row, and no other followed: here bytes need not take their time

_TOLERANCE_S = 0.0005
_CLOCKS = 0.03  # by so much a starter's bits may be shorter than ours


class Pace:
    """Told of every right reply on one port."""

    def __init__(self) -> None:
        self._kept = 0
        self._is_known_not_to = False
        self._doubts: dict[tuple[int, float], int] = {}  # in a row, by unit and length
        self._doubted: tuple[int, float] | None = None  # the latest, until it shows whether we were right

    def is_too_soon(self, unit: int, *, early_s: float, reply_s: float) -> bool:
        """Return whether a reply of this length cannot be the answer: it began `early_s` before it might."""
        if self._is_known_not_to:
            return False
        if early_s <= _TOLERANCE_S + _CLOCKS * reply_s:
            self._kept += 1
            if self._doubts:
                self._doubts.pop((unit, reply_s), None)
            return False
        if self._kept < KEPT_ENOUGH:
            self._kept = 0
            return False
        self._doubted = (unit, reply_s)
        return True

    def note_stray(self, unit: int) -> None:
        """Take over that a unit sent one more frame: it was right to doubt the one before."""
        if self._doubted is not None and self._doubted[0] == unit:
            self._doubts.pop(self._doubted, None)
            self._doubted = None

    def note_asked(self, unit: int) -> None:
        """Take over that a unit is asked: had it sent one more frame, that would have come by now."""
        if self._doubted is not None and self._doubted[0] == unit:
            doubts = self._doubts[self._doubted] = self._doubts.get(self._doubted, 0) + 1
            self._is_known_not_to = doubts >= DOUBTS_ENOUGH
            self._doubted = None
