"""How much of the line's time goes to units that do not answer."""

from __future__ import annotations

import random
from math import inf

BACK_OFF_FLOOR_S = 1.0
BACK_OFF_CEILING_S = 16.0
# Of the line's time, for all silent units together: with the listening for a late reply that follows each
# silence, and is not counted here, that makes a twentieth at most.
SILENT_SHARE = 0.035
SAVED_S = 20.0  # the share of so many seconds can be saved up

_MOST_DOUBLINGS = 16


def back_off_s(
    pace_s: float, probes: int, *, jitter: float, chance: random.Random, ceiling_s: float = BACK_OFF_CEILING_S
) -> float:
    """Return the pause after so many probes in vain: twice the last, up to the ceiling, jittered."""
    delay_s = min(pace_s * 2.0 ** min(probes, _MOST_DOUBLINGS), max(ceiling_s, pace_s))
    return delay_s * (1.0 + jitter * chance.uniform(-1.0, 1.0))


class SilenceBudget:
    """A bucket of line time that fills by the silent units' share, and that each probe in vain draws on.

    A probe is only sent when the bucket holds its cost. One that is worth it now, since the unit has probably
    come back, may draw in advance what can be saved up; it costs nothing when it is answered.
    """

    def __init__(self) -> None:
        self._paid_s = -inf  # when everything spent so far is paid for

    def begin(self, now_s: float) -> None:
        """Begin with an empty bucket."""
        if self._paid_s == -inf:
            self._paid_s = now_s + SAVED_S

    def from_s(self, cost_s: float, *, in_advance: bool) -> float:
        """Return from when on a probe of this cost may be sent."""
        return self._paid_s + cost_s / SILENT_SHARE - (2 * SAVED_S if in_advance else SAVED_S)

    def forgive(self, now_s: float) -> None:
        """Forget what was spent: while nobody answered it was nobody's time."""
        self._paid_s = min(self._paid_s, now_s)

    def spend(self, cost_s: float, now_s: float) -> None:
        """Take over that a probe has cost so much, in vain."""
        self._paid_s = max(self._paid_s, now_s) + cost_s / SILENT_SHARE
