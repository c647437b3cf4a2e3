"""The number that tells records of one boot apart and puts them in order."""

from __future__ import annotations


class Sequence:
    """Counts up by one from 1; the gateway has exactly one, used on the application's loop only."""

    def __init__(self) -> None:
        self._last = 0

    def take(self) -> int:
        """Return the next number."""
        self._last += 1
        return self._last
