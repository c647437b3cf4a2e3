"""Whether a request holds back for what has arrived but not reached the line yet: it may be a stop.

What that adds to a request is within `budget.ALLOWANCE_S`, which `check` reckons with.
"""

from __future__ import annotations

from collections.abc import Callable

GRACE_S = 0.003  # from the broker to the line a stop needs one, on a busy machine up to three
LOOK_EVERY_S = 0.0002
SHARE = 0.01  # of the line's time: whatever keeps arriving does not slow it down by more
CREDIT_S = 0.01  # as much may be saved up


class StopHold:
    """Decides for one line; `has_arrived` tells whether there is such a thing."""

    def __init__(self, has_arrived: Callable[[], bool]) -> None:
        self._has_arrived = has_arrived
        self._credit_s = CREDIT_S
        self._reckoned_s: float | None = None

    def is_worth_waiting(self, now_s: float, began_s: float | None = None) -> bool:
        """Return whether to hold the next request back, or to go on doing so since `began_s`."""
        if began_s is not None:
            return now_s - began_s < GRACE_S and self._has_arrived()
        if self._reckoned_s is not None:
            earned_s = (now_s - self._reckoned_s) * SHARE
            self._credit_s = min(self._credit_s + earned_s, CREDIT_S)
        self._reckoned_s = now_s
        return self._credit_s > 0.0 and self._has_arrived()

    def waited(self, began_s: float, now_s: float) -> None:
        """Take note that a request was held back."""
        self._credit_s -= now_s - began_s
