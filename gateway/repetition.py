"""Trouble that comes again and again is told once, then counted."""

from __future__ import annotations


class Repetition:
    """Tells news from repetition: the same trouble in a row is news only the first time."""

    def __init__(self) -> None:
        self._last: str | None = None
        self.count = 0  # how often the present trouble has come

    def is_news(self, trouble: BaseException) -> bool:
        """Return whether this has not just been told."""
        what = repr(trouble)
        self.count = self.count + 1 if what == self._last else 1
        self._last = what
        return self.count == 1
