"""How far a command has come, on stderr: one line that changes on a terminal, a few lines elsewhere."""

from __future__ import annotations

import sys
from typing import TextIO

STEP = 0.1  # of the whole, between two lines where there is no terminal

_CLEAR = "\r\x1b[K"


class Progress:
    """Shows a share of the whole and the time left."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._is_terminal = self._stream.isatty()
        self._next_share = 0.0
        self._is_shown = False

    def show(self, share: float, what: str, *, left_s: float | None = None) -> None:
        """Show that this share (0..1) is done, what is being done, and how long the rest will take."""
        left = "" if left_s is None else f", {in_words(left_s)} left"
        text = f"{min(share, 1.0):4.0%} {what}{left}"
        if self._is_terminal:
            self._stream.write(_CLEAR + text)
            self._is_shown = True
        elif share >= self._next_share:
            self._next_share = (int(share / STEP) + 1) * STEP
            self._stream.write(text + "\n")
        self._stream.flush()

    def say(self, text: str) -> None:
        """Say something that stays."""
        self.clear()
        self._stream.write(text + "\n")
        self._stream.flush()

    def clear(self) -> None:
        """Take the changing line away."""
        if self._is_shown:
            self._stream.write(_CLEAR)
            self._stream.flush()
            self._is_shown = False

    def end(self) -> None:
        """Take the changing line away for good: what is shown next is the beginning of something else."""
        self.clear()
        self._next_share = 0.0


def in_words(seconds: float) -> str:
    """Return a duration for people: 4.2 s, 38 s, 3 min 20 s, 1 h 5 min."""
    if seconds < 10:
        return f"{max(seconds, 0.0):.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"
