"""Logging never waits, not even for a journal that takes nothing."""

from __future__ import annotations

import logging
import os
from threading import Event

import pytest

from gateway.system.log_thread import BackgroundHandler


def logger(handler: logging.Handler) -> logging.Logger:
    made = logging.Logger("test")
    made.addHandler(handler)
    return made


def test_records_are_written_in_order_with_their_format_and_a_closed_pipe_is_no_error() -> None:
    reading, writing = os.pipe()
    handler = BackgroundHandler(writing)
    handler.setFormatter(logging.Formatter("%(levelname)s %(message)s"))
    log = logger(handler)

    log.info("unit=%s answers", 7)
    log.error("a %s\nof two lines", "text")
    handler.close()

    assert os.read(reading, 1000) == b"INFO unit=7 answers\nERROR a text\nof two lines\n"
    os.close(reading)
    handler = BackgroundHandler(writing)
    logger(handler).info("lost")
    handler.close()
    os.close(writing)


def test_a_full_pipe_holds_no_one_up_and_what_is_lost_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[bytes] = []
    begun, goes_on = Event(), Event()

    def write(_fd: int, octets: bytes) -> int:
        begun.set()
        assert goes_on.wait(30.0)
        written.append(octets)
        return len(octets)

    monkeypatch.setattr(os, "write", write)
    handler = BackgroundHandler(1, most_waiting=10)
    log = logger(handler)
    log.info("first")
    assert begun.wait(30.0)
    for number in range(100):
        log.info("record %s", number)

    assert handler.dropped == 90
    goes_on.set()
    while b"record 9\n" not in written:
        os.sched_yield()
    log.info("again")
    handler.close()
    assert written[-2:] == [b"90 log lines were lost: they were not read in time\n", b"again\n"]
    assert len(written) == 13
