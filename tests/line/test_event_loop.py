from __future__ import annotations

import asyncio
import os
import selectors
import time
from collections.abc import Iterator
from typing import Any

import pytest

from gateway.line.port.event_loop import (
    DESCRIPTOR_LIMIT,
    PreciseSelector,
    new_precise_loop,
)

READ, WRITE = 1, 2


@pytest.fixture
def selector() -> Iterator[PreciseSelector]:
    with PreciseSelector() as made:
        yield made


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    reader, writer = os.pipe()
    yield reader, writer
    os.close(reader)
    os.close(writer)


def test_a_descriptor_that_select_cannot_watch_is_refused(selector: PreciseSelector) -> None:
    with pytest.raises(ValueError, match="too many open files"):
        selector.register(DESCRIPTOR_LIMIT, READ)


def run_on(loop: asyncio.AbstractEventLoop, main: Any) -> None:
    with asyncio.Runner(loop_factory=lambda: loop) as runner:
        runner.run(main)


def test_a_loop_that_is_held_up_is_reported_by_how_much() -> None:
    delays_s: list[float] = []

    async def scenario() -> None:
        await asyncio.sleep(0.001)
        until_s = time.monotonic() + 0.02
        while time.monotonic() < until_s:
            pass
        await asyncio.sleep(0.001)

    run_on(new_precise_loop(delays_s.append), scenario())

    assert max(delays_s) >= 0.02
    assert sorted(delays_s)[0] >= 0.0


def test_what_came_while_the_thread_was_held_up_is_read_before_an_alarm_that_is_late(
    selector: PreciseSelector, pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    plain, monotonic = selectors.SelectSelector.select, time.monotonic
    late_s: list[float] = []

    def held_up(self: selectors.SelectSelector, timeout: float | None = None) -> Any:
        found = plain(self, timeout)
        if not late_s:
            late_s.append(
                0.01
            )  # as when another thread has the interpreter, or another program the processor
            os.write(pipe[1], b"x")
        return found

    monkeypatch.setattr(time, "monotonic", lambda: monotonic() + sum(late_s))
    monkeypatch.setattr(selectors.SelectSelector, "select", held_up)
    selector.add_quick_reader(pipe[0], lambda: done.append("read"))
    selector.alarms[lambda: done.append("alarm")] = time.monotonic() + 0.001

    selector.select(1.0)
    selector.select(1.0)

    assert done == ["read", "alarm"]
