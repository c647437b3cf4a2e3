"""Logging that never blocks the caller: a thread writes to stderr.

A full pipe to the journal would otherwise block every thread that logs, the lines' loop among them.
"""

from __future__ import annotations

import logging
import os
import queue
from contextlib import suppress
from threading import Thread

MOST_WAITING = 1000  # records; more are counted and dropped
FLUSH_S = 1.0  # at the end


class BackgroundHandler(logging.StreamHandler["BackgroundHandler"]):
    """Formats in the caller's thread and writes in its own; lines that do not fit are counted."""

    def __init__(self, fd: int, *, most_waiting: int = MOST_WAITING) -> None:
        super().__init__(self)
        self._waiting: queue.Queue[str | None] = queue.Queue(most_waiting)
        self._fd = fd
        self.dropped = 0
        self._thread = Thread(target=self._write_all, name="log", daemon=True)
        self._thread.start()

    def write(self, text: str) -> None:
        """Take a line, or count it."""
        try:
            if self.dropped:
                self._waiting.put_nowait(f"{self.dropped} log lines were lost: they were not read in time\n")
                self.dropped = 0
            self._waiting.put_nowait(text)
        except queue.Full:
            self.dropped += 1

    def flush(self) -> None:
        """Wait for nothing."""

    def close(self) -> None:
        """Write what waits, for a moment; then give up."""
        with suppress(queue.Full):
            self._waiting.put_nowait(None)
        self._thread.join(FLUSH_S)
        super().close()

    def _write_all(self) -> None:
        while (text := self._waiting.get()) is not None:
            octets = text.encode("utf-8", "backslashreplace")
            with suppress(OSError):  # stderr is closed
                while octets:
                    octets = octets[os.write(self._fd, octets) :]
