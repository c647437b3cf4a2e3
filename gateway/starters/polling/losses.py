"""How many polls of one starter are lost: a poor line is not a lost starter."""

from __future__ import annotations

from gateway.contract import EventCode, phrase

OF = 200  # polls are looked at
POOR, GOOD_AGAIN = 8, 3  # of them lost: from 4 % on it is said, until it is 1.5 % or less
_ALL = (1 << OF) - 1


class PollLosses:
    """Counts the lost polls among the latest."""

    def __init__(self) -> None:
        self._latest = 0  # a bit for each, 1 for a lost one; the latest is the lowest
        self._count = self._lost = 0
        self._is_poor = False

    def note(self, *, is_lost: bool) -> str | None:
        """Count a poll; return what is wrong, "" once nothing is any more, None for no news."""
        self._lost += is_lost - (self._latest >> (OF - 1))
        self._latest = (self._latest << 1 | is_lost) & _ALL
        self._count = min(self._count + 1, OF)
        was_poor = self._is_poor
        self._is_poor = self._lost >= POOR or (was_poor and self._lost > GOOD_AGAIN)
        if self._is_poor is was_poor:
            return None
        if not self._is_poor:
            return ""
        return phrase(EventCode.DEGRADED, "polls_lost", lost=self._lost, count=self._count)

    def clear(self) -> None:
        """Count from the beginning: the starter itself was lost."""
        self._latest = self._count = self._lost = 0
        self._is_poor = False
