from __future__ import annotations

import asyncio
import ctypes
import os
import selectors
import time
from collections.abc import Iterator
from typing import Any

import pytest

from gateway.line import precise_selector
from gateway.line.precise_selector import PreciseSelector, new_precise_loop


@pytest.fixture
def selector() -> Iterator[PreciseSelector]:
    with PreciseSelector() as made:
        yield made


@pytest.mark.parametrize("timeout_s", [1e-9, 0.00005, 0.0004, 0.002005])
def test_a_wait_never_ends_early(selector: PreciseSelector, timeout_s: float) -> None:
    for _ in range(5):
        started_s = time.monotonic()
        assert selector.select(timeout_s) == []
        assert time.monotonic() - started_s >= timeout_s


def test_a_wait_for_nothing_returns_at_once(selector: PreciseSelector) -> None:
    selector.select(0.00001)

    assert selector.select(0) == []
    assert selector.select(-1.0) == []


def test_a_ready_file_is_reported_and_the_timer_never(selector: PreciseSelector) -> None:
    reader, writer = os.pipe()
    try:
        selector.register(reader, selectors.EVENT_READ, "pipe")
        selector.select(0.00001)  # the timer has fired once
        os.write(writer, b"x")

        for timeout_s in (None, 10.0):
            assert [key.data for key, _ in selector.select(timeout_s)] == ["pipe"]
    finally:
        os.close(reader)
        os.close(writer)


def test_between_two_callbacks_files_are_looked_at_only_every_so_often(
    selector: PreciseSelector, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = 100.0
    monkeypatch.setattr(precise_selector.time, "monotonic", lambda: now_s)
    reader, writer = os.pipe()
    try:
        selector.register(reader, selectors.EVENT_READ, "pipe")
        assert selector.select(0) == []
        os.write(writer, b"x")

        now_s += 0.9 * precise_selector.LOOK_EVERY_S
        assert selector.select(0) == []
        now_s += 0.2 * precise_selector.LOOK_EVERY_S
        assert [key.data for key, _ in selector.select(0)] == ["pipe"]
    finally:
        os.close(reader)
        os.close(writer)


def test_an_earlier_timer_does_not_end_a_wait_without_limit(selector: PreciseSelector) -> None:
    reader, writer = os.pipe()
    try:
        selector.register(reader, selectors.EVENT_READ)
        os.write(writer, b"x")
        assert selector.select(0.002)  # the file is ready; the timer stays armed
        os.read(reader, 1)
        os.write(writer, b"x")

        assert len(selector.select(None)) == 1
    finally:
        os.close(reader)
        os.close(writer)


def test_a_loop_runs_its_timers_in_order_and_never_early() -> None:
    fired: list[tuple[int, float]] = []

    async def scenario() -> None:
        loop = asyncio.get_running_loop()
        done = loop.create_future()
        start_s = loop.time()
        delays_s = [0.003, 0.001, 0.0022, 0.0, 0.0005]
        for at, delay_s in enumerate(delays_s):
            loop.call_at(
                start_s + delay_s, lambda at=at, due=start_s + delay_s: fired.append((at, loop.time() - due))
            )
        loop.call_at(start_s + 0.004, done.set_result, None)
        await done

    with asyncio.Runner(loop_factory=new_precise_loop) as runner:
        runner.run(scenario())

    assert [at for at, _ in fired] == [3, 4, 1, 2, 0]
    assert all(late_s >= -1e-9 for _, late_s in fired)


def test_a_closed_selector_keeps_no_descriptor_and_may_be_closed_twice() -> None:
    before = set(os.listdir("/proc/self/fd"))

    selector = PreciseSelector()
    selector.close()
    selector.close()

    assert set(os.listdir("/proc/self/fd")) == before


class _NoTimers:
    def __init__(self, *_: Any, **__: Any) -> None: ...


class _FailingTimers(_NoTimers):
    def timerfd_create(self, *_: int) -> int:
        ctypes.set_errno(38)  # ENOSYS
        return -1

    timerfd_settime = timerfd_create


@pytest.mark.parametrize("library", [_NoTimers, _FailingTimers])
def test_without_timerfd_the_loop_has_the_default_selector(
    monkeypatch: pytest.MonkeyPatch, library: type[_NoTimers]
) -> None:
    monkeypatch.setattr(precise_selector.ctypes, "PyDLL", library)

    with asyncio.Runner(loop_factory=new_precise_loop) as runner:
        assert runner.run(asyncio.sleep(0, "works")) == "works"


def test_a_timer_that_cannot_be_set_is_an_error(
    selector: PreciseSelector, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(selector, "_settime", lambda *_: -1)

    with pytest.raises(OSError, match="timerfd_settime"):
        selector.select(1.0)
