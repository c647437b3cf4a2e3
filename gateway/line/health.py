"""Whether a unit answers: one state machine, told of each outcome."""

from __future__ import annotations

import enum
from typing import assert_never

from gateway.line.outcome import Answered, Garbled, Outcome, Refused, Silent

_GARBLED_THAT_MISS = 2  # a single garbled reply is the line's fault more often than the unit's


class UnitState(enum.Enum):
    """What is known of a unit."""

    NEW = "new"  # never answered, never missed
    ANSWERING = "answering"
    SUSPECT = "suspect"  # missed once
    SILENT = "silent"


class Sign(enum.Enum):
    """What an outcome says of the unit's life."""

    ANSWER = "answer"
    MISS = "miss"


TRANSITIONS = {
    (UnitState.NEW, Sign.ANSWER): UnitState.ANSWERING,
    (UnitState.NEW, Sign.MISS): UnitState.SUSPECT,
    (UnitState.ANSWERING, Sign.ANSWER): UnitState.ANSWERING,
    (UnitState.ANSWERING, Sign.MISS): UnitState.SUSPECT,
    (UnitState.SUSPECT, Sign.ANSWER): UnitState.ANSWERING,
    (UnitState.SUSPECT, Sign.MISS): UnitState.SILENT,
    (UnitState.SILENT, Sign.ANSWER): UnitState.ANSWERING,
    (UnitState.SILENT, Sign.MISS): UnitState.SILENT,
}


class UnitHealth:
    """The state of one unit, moved by outcomes."""

    def __init__(self) -> None:
        self.state = UnitState.NEW
        self._garbled_in_row = 0
        self._forgiven_until_s = float("-inf")

    def expect_silence(self, until_s: float) -> None:
        """Count no misses until then."""
        self._forgiven_until_s = max(self._forgiven_until_s, until_s)

    def is_forgiven(self, now_s: float) -> bool:
        """Return whether misses do not count now."""
        return now_s < self._forgiven_until_s

    def take(self, outcome: Outcome, now_s: float) -> Sign | None:
        """Move on by one outcome; return what it said of the unit, None when nothing.

        A miss in a time of expected silence is returned, but does not count.
        """
        sign = self._sign_of(outcome)
        if sign is None or (sign is Sign.MISS and self.is_forgiven(now_s)):
            return sign
        self.state = TRANSITIONS[self.state, sign]
        return sign

    def _sign_of(self, outcome: Outcome) -> Sign | None:
        match outcome:
            case Answered() | Refused():
                self._garbled_in_row = 0
                return Sign.ANSWER
            case Silent(is_sent=is_sent):
                self._garbled_in_row = 0
                return Sign.MISS if is_sent else None
            case Garbled():
                self._garbled_in_row += 1
                return Sign.MISS if self._garbled_in_row >= _GARBLED_THAT_MISS else None
            case _:
                assert_never(outcome)
