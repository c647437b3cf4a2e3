"""A trace is logged once, then counted."""

from __future__ import annotations

import io
import logging

import pytest

from gateway.system.log_thread import TraceFilter


class Log:
    """A logger whose lines can be read."""

    def __init__(self) -> None:
        self._stream = io.StringIO()
        handler = logging.StreamHandler(self._stream)
        handler.addFilter(TraceFilter())
        self.logger = logging.Logger("gateway.store.worker")
        self.logger.addHandler(handler)

    def fail(self, message: str = "work failed", *args: object, error: type[Exception] = ValueError) -> None:
        try:
            raise error("a foreign text")  # noqa: TRY301 - it is to have a trace
        except error:
            self.logger.exception(message, *args)

    def text(self) -> str:
        return self._stream.getvalue()


def test_a_trace_that_comes_again_and_again_is_logged_once_and_counted() -> None:
    log = Log()

    for _ in range(2_500):
        log.fail()

    assert log.text().count("Traceback") == 1
    assert log.text().splitlines()[-3:] == [
        f"work failed (the same ValueError for the {count}th time)" for count in (10, 100, 1000)
    ]


def test_foreign_data_in_the_message_does_not_make_an_error_another_one() -> None:
    log = Log()

    for number in range(20):
        log.fail(f"Exception in callback take(payload {number})\nhandle: " + "x" * 4096)

    assert log.text().count("Traceback") == 1
    assert len(log.text()) < 6000


@pytest.mark.parametrize("other", [{"error": KeyError}, {"args": ("b",)}])
def test_another_error_has_its_own_trace(other: dict[str, object]) -> None:
    log = Log()

    for _ in range(3):
        log.fail("line=%s crashed", "a")
        log.fail("line=%s crashed", *other.get("args", ("a",)), error=other.get("error", ValueError))  # type: ignore[misc, arg-type]

    assert log.text().count("Traceback") == 2
