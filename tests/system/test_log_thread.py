"""Logging never waits, not even for a journal that takes nothing."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterator
from contextlib import suppress

import pytest

from gateway.system.log_thread import BackgroundHandler


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    reading, writing = os.pipe()
    yield reading, writing
    for fd in (reading, writing):
        os.close(fd)


def logger(handler: logging.Handler) -> logging.Logger:
    made = logging.Logger("test")
    made.addHandler(handler)
    return made


def test_records_are_written_in_order_with_their_format(pipe: tuple[int, int]) -> None:
    handler = BackgroundHandler(pipe[1])
    handler.setFormatter(logging.Formatter("%(levelname)s %(message)s"))
    log = logger(handler)

    log.info("unit=%s answers", 7)
    log.error("a %s\nof two lines", "text")
    handler.close()

    assert os.read(pipe[0], 1000) == b"INFO unit=7 answers\nERROR a text\nof two lines\n"


def test_a_full_pipe_holds_no_one_up_and_what_is_lost_is_counted(pipe: tuple[int, int]) -> None:
    reading, writing = pipe
    _fill(writing)
    handler = BackgroundHandler(writing, most_waiting=10)
    log = logger(handler)
    log.info("first")
    _wait_until_taken(handler)  # the thread stands in its write from now on

    begun_s = time.monotonic()
    for number in range(100):
        log.info("record %s", number)
    took_s = time.monotonic() - begun_s

    assert took_s < 1.0
    assert handler.dropped == 90
    _read_until(reading, b"record ", 100 - handler.dropped)
    log.info("again")
    handler.close()
    reported = _read_all(reading).decode()
    assert "log lines were lost: they were not read in time\n" in reported
    assert reported.endswith("again\n")


def test_a_pipe_that_no_one_reads_any_more_is_no_error() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    handler = BackgroundHandler(writing)

    logger(handler).info("lost")
    handler.close()

    os.close(writing)


def _fill(fd: int) -> None:
    os.set_blocking(fd, False)
    with suppress(BlockingIOError):
        while True:
            os.write(fd, b"x" * 4096)
    os.set_blocking(fd, True)


def _wait_until_taken(handler: BackgroundHandler) -> None:
    give_up_s = time.monotonic() + 30.0
    while not handler.queue.empty():
        assert time.monotonic() < give_up_s
        os.sched_yield()


def _read_until(fd: int, mark: bytes, count: int) -> None:
    """Read a pipe until it has given a mark so often."""
    found = b""
    while found.count(mark) < count:
        found += os.read(fd, 65536)


def _read_all(fd: int) -> bytes:
    """Return what a pipe holds, and what is written as it empties."""
    os.set_blocking(fd, False)
    found = b""
    quiet_from_s = time.monotonic()
    while time.monotonic() - quiet_from_s < 0.2:
        try:
            found += os.read(fd, 65536)
            quiet_from_s = time.monotonic()
        except BlockingIOError:
            continue
    return found
