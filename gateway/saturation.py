"""Whether a line has had no time to spare for long: then values get older than their periods say."""

from __future__ import annotations

FULL = 0.95  # of its time
RELIEVED = 0.90
FOR_S = 60.0


class Saturation:
    """Watches one line's utilisation; a change is told once it has lasted for a minute."""

    def __init__(self) -> None:
        self._is_full = False
        self._since_s: float | None = None  # when it began to look otherwise

    def take(self, utilisation: float, now_s: float) -> bool | None:
        """Return whether the line is full when that has just changed, None otherwise."""
        is_otherwise = utilisation < RELIEVED if self._is_full else utilisation > FULL
        if not is_otherwise:
            self._since_s = None
            return None
        if self._since_s is None:
            self._since_s = now_s
        if now_s - self._since_s < FOR_S:
            return None
        self._is_full, self._since_s = not self._is_full, None
        return self._is_full
