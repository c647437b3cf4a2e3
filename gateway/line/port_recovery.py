"""When a port has gone deaf: it is open, requests go out, and no unit answers any more.

Adapters do that without an error (a USB urb that stopped, a driver that lost its interrupt); to close and
open the port again helps. Where it does not, perhaps everything on the line is switched off: then it is tried
ever less often.
"""

from __future__ import annotations

from math import inf

from gateway.contract import EventCode, phrase
from gateway.line.rtu.transaction import Answered, Outcome, Refused

LONGEST_S = 600.0  # between two attempts
ASK_EVERY_S = 2.0  # all silent units, while none answers: that takes no time from others
DEAF = phrase(EventCode.PORT_DEAF, "reason")  # as it is reported


class PortRecovery:
    """Judges by every outcome on a line; `after_s` None or 0: never deaf."""

    def __init__(self, after_s: float | None) -> None:
        self._after_s = after_s or inf
        self._patience_s = self._after_s
        self._since_s: float | None = None  # no unit has answered
        self._asked_s = -inf
        self._is_back = False  # a unit has answered after a while in which none did
        self.is_deaf = False  # from the first attempt to cure it to the next answer

    def begin(self) -> None:
        """Begin on an opened port."""
        self._since_s = None

    def is_time_to_ask(self, now_s: float) -> bool:
        """Return whether all should be asked now: a line that works again is to be found at once."""
        if self._is_back:
            self._is_back = False
            return True
        since_s = self._since_s
        if since_s is None or now_s - max(since_s, self._asked_s) < ASK_EVERY_S:
            return False
        self._asked_s = now_s
        return True

    def note_late(self) -> None:
        """Record that a reply came too late: the port receives."""
        if not self.is_deaf:
            self._since_s = None

    def record(self, outcome: Outcome, now_s: float) -> bool:
        """Record the outcome of a request; return whether the port should be opened afresh now."""
        if isinstance(outcome, Answered | Refused):
            if self.is_deaf or (self._since_s is not None and now_s - self._since_s >= ASK_EVERY_S):
                self._is_back = True
            self._since_s = None
            self._patience_s = self._after_s
            self.is_deaf = False
            return False
        if self._since_s is None:
            self._since_s = now_s
        if now_s - self._since_s < self._patience_s:
            return False
        self._patience_s = min(2 * self._patience_s, max(LONGEST_S, self._after_s))
        self.is_deaf = True
        return True
