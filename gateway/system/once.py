"""Saying a thing once: `ChangeDetector` passes what is new, `HoldOff` the first after a quiet time."""

from __future__ import annotations

from math import inf


class ChangeDetector:
    """Knows what was said last."""

    def __init__(self, said: object = None) -> None:
        self._said = said

    def is_new(self, what: object) -> bool:
        """Return whether this differs from what was said last, and count it as said."""
        is_new = what != self._said
        self._said = what
        return is_new


class HoldOff:
    """Sounds for the first of several, and again only once it was quiet for long enough."""

    def __init__(self, quiet_s: float) -> None:
        self._quiet_s = quiet_s
        self._last_s = -inf

    def sounds(self, now_s: float) -> bool:
        """Count one, and return whether it is worth saying."""
        is_quiet = now_s - self._last_s >= self._quiet_s
        self._last_s = now_s
        return is_quiet
