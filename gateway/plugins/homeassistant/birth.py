"""When the births of Home Assistant are answered; pure.

All messages are published again, after a pause drawn by chance, so that many gateways do not answer
together; at most once in `LONGEST_PAUSE_S`.
"""

from __future__ import annotations

import random
from math import inf

LONGEST_PAUSE_S = 5.0
BORN = b"online"  # Home Assistant's birth message; its will is `offline`


class BirthPause:
    """When the next answer to a birth is due; times on the steady clock."""

    def __init__(self, seed: int) -> None:
        self._chance = random.Random(seed)
        self._due_s = inf
        self._answered_s = -LONGEST_PAUSE_S

    def take(self, payload: bytes, now_s: float) -> None:
        """Take a message of the birth topic; what comes while an answer is due is answered with it."""
        if payload == BORN and self._due_s == inf:
            pause_s = self._chance.uniform(0.0, LONGEST_PAUSE_S)
            self._due_s = max(now_s + pause_s, self._answered_s + LONGEST_PAUSE_S)

    def left_s(self, now_s: float) -> float:
        """Return how long it is until an answer is due, 0 when it is; infinite while there was no birth."""
        return max(0.0, self._due_s - now_s)

    def answered(self, now_s: float) -> None:
        """Note that all messages were published again."""
        self._due_s, self._answered_s = inf, now_s
