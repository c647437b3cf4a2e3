"""Logging that never blocks the caller: a thread writes to stderr.

A full pipe to the journal would otherwise block every thread that logs, the lines' loop among them.
Trouble that comes again and again is logged once, then counted (`TraceFilter`).
"""

from __future__ import annotations

import logging
import logging.handlers
import os
import queue
from collections import OrderedDict
from contextlib import suppress
from threading import Thread
from types import TracebackType

MOST_WAITING = 1000  # records; more are counted and dropped
FLUSH_S = 1.0  # at the end


class BackgroundHandler(logging.handlers.QueueHandler):
    """Formats in the caller's thread and writes in its own; lines that do not fit are counted."""

    def __init__(self, fd: int, *, most_waiting: int = MOST_WAITING) -> None:
        self._waiting: queue.Queue[str | None] = queue.Queue(most_waiting)
        super().__init__(self._waiting)
        self._fd = fd
        self.dropped = 0
        self._thread = Thread(target=self._write_all, name="log", daemon=True)
        self._thread.start()

    def prepare(self, record: logging.LogRecord) -> str:
        """Return the record's text."""
        return self.format(record) + "\n"

    def enqueue(self, record: str) -> None:  # type: ignore[override] # what `prepare` returns
        """Take a text, or count it."""
        try:
            if self.dropped:
                self._waiting.put_nowait(f"{self.dropped} log lines were lost: they were not read in time\n")
                self.dropped = 0
            self._waiting.put_nowait(record)
        except queue.Full:
            self.dropped += 1

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


MOST_KNOWN = 200  # different errors; the one that was not seen for longest counts as new after that


class TraceFilter(logging.Filter):
    """Lets the trace of an error pass once, then a line without it at the 10th, 100th, 1000th time.

    The same error is one of the same kind, raised at the same place and reported by the same logger with the
    same arguments; its message may differ, because asyncio puts foreign data into that.
    """

    def __init__(self) -> None:
        super().__init__()
        self._counts: OrderedDict[object, int] = OrderedDict()

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is logged; a repeated one without its trace."""
        kind, _, trace = record.exc_info or (None, None, None)
        if kind is None:
            return True
        key = (record.name, repr(record.args), kind, *_place(trace))
        count = self._counts.pop(key, 0) + 1
        self._counts[key] = count
        if len(self._counts) > MOST_KNOWN:
            self._counts.popitem(last=False)
        if count == 1:
            return True
        if str(count).rstrip("0") != "1":
            return False
        record.msg = (
            f"{record.getMessage().splitlines()[0][:200]} (the same {kind.__name__} for the {count}th time)"
        )
        record.args = record.exc_info = record.exc_text = None
        return True


def _place(trace: TracebackType | None) -> tuple[str, int]:
    """Return file and line where an exception was raised."""
    if trace is None:
        return "", 0
    while trace.tb_next is not None:
        trace = trace.tb_next
    return trace.tb_frame.f_code.co_filename, trace.tb_lineno
