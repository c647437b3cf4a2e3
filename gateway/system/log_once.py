"""Trouble that comes again and again is logged once, then counted: the one place where this is decided."""

from __future__ import annotations

import logging
from collections import OrderedDict
from types import TracebackType

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
