"""Exponential back-off: the pauses between attempts grow up to a longest one; pure."""

from __future__ import annotations

import random

MOST_STEPS = 16  # beyond that no pause grows


def backoff_s(first_s: float, longest_s: float, attempts: int, *, factor: float = 2.0) -> float:
    """Return the pause after so many failed attempts: `first_s` after none."""
    return min(first_s * factor ** min(attempts, MOST_STEPS), longest_s)


class Backoff:
    """The pauses between attempts; with a seed each but the shortest is up to a quarter shorter.

    So many gateways do not reconnect in step.
    """

    def __init__(self, first_s: float, longest_s: float, *, seed: int | None = None) -> None:
        self._first_s = first_s
        self._longest_s = longest_s
        self._chance = None if seed is None else random.Random(seed)
        self._attempts = 0

    def next_s(self) -> float:
        """Return how long to wait before the next attempt."""
        pause_s = backoff_s(self._first_s, self._longest_s, self._attempts)
        self._attempts += 1
        if self._chance is not None:
            pause_s *= 1 - 0.25 * self._chance.random()
        return max(pause_s, self._first_s)

    def reset(self) -> None:
        """Begin again with the shortest pause."""
        self._attempts = 0
