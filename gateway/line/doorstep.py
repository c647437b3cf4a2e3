"""Whether a request holds back for what has arrived but not reached the line yet: it may be a stop."""

from __future__ import annotations

from collections.abc import Callable
from math import inf

GRACE_S = 0.003  # from the broker to the line a stop needs one, on a busy machine up to three
LOOK_EVERY_S = 0.0002
REST = 50  # times as long as a request held back, none does: a fiftieth of the line's time at most


class Doorstep:
    """Decides for one line; `has_arrived` tells whether there is such a thing."""

    def __init__(self, has_arrived: Callable[[], bool]) -> None:
        self._has_arrived = has_arrived
        self._rests_until_s = -inf

    def is_worth_waiting(self, now_s: float, began_s: float | None = None) -> bool:
        """Return whether to hold the next request back, or to go on doing so since `began_s`."""
        if began_s is None:
            return now_s >= self._rests_until_s and self._has_arrived()
        return now_s - began_s < GRACE_S and self._has_arrived()

    def waited(self, began_s: float, now_s: float) -> None:
        """Take note that a request was held back; whatever keeps arriving must not slow the line down."""
        self._rests_until_s = now_s + REST * (now_s - began_s)
