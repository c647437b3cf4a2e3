"""The last frames of a line, for reports of what happened."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable

LONGEST_SHOWN = 256  # bytes, the longest frame; a flood is longer

SENT, RECEIVED, STRAY = ">>", "<<", "??"  # the directions; what was not waited for is a stray

Tap = Callable[[float, str, bytes], None]  # the line's clock, direction, bytes

logger = logging.getLogger(__name__)


class Trace:
    """A short ring of frames; each is also logged in hex at DEBUG."""

    def __init__(self, line: str, *, size: int = 16) -> None:
        self._line = line
        self._ring: deque[tuple[float, str, bytes]] = deque(maxlen=size)
        self._is_logged = logger.isEnabledFor(logging.DEBUG)
        self.tap: Tap | None = None  # is given every frame too

    def note(self, at_s: float, direction: str, frame: bytes) -> None:
        """Store a frame, or whatever came instead of one."""
        self._ring.append((at_s, direction, frame[:LONGEST_SHOWN]))
        if self.tap is not None:
            self.tap(at_s, direction, frame)
        if self._is_logged:
            logger.debug("line=%s %.6f %s %s", self._line, at_s, direction, frame.hex(" "))

    def frames(self) -> tuple[str, ...]:
        """Return the frames as text, oldest first: seconds on the line's clock, direction, hex."""
        return tuple(f"{at_s:.6f} {direction} {frame.hex(' ')}" for at_s, direction, frame in self._ring)
