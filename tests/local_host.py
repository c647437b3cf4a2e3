"""A `gateway.app.plant.Host` whose lines run on the test's own loop, so that time can be virtual."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

from gateway.line.client import LineClient, post_here
from gateway.line.events import POLLS_WAIT_S, EventQueue, LineEvent, deliver
from gateway.line.line import Line
from gateway.line.port.base import PortOpener
from gateway.line.scheduler.requests import Poll
from gateway.modbus.timing import LineTiming


class LocalHost:
    """As `LineHost`, without the thread; lines begin as they are added."""

    seed = 0  # not by chance: what differs between two runs must come from what is tested

    def __init__(self, handle: Callable[[LineEvent], None], polls_wait_s: float = POLLS_WAIT_S) -> None:
        loop = asyncio.get_running_loop()
        self._events = EventQueue(
            lambda batch: loop.call_soon(deliver, batch, handle), polls_wait_s=polls_wait_s
        )
        self.lines: dict[str, tuple[asyncio.Task[None], Line]] = {}
        self._ending: set[asyncio.Task[None]] = set()

    def add_line(
        self,
        *,
        name: str,
        opener: PortOpener,
        timing: LineTiming,
        polls: Sequence[Poll],
        allowance_s: float,
        seed: int,
        deaf_after_s: float,
    ) -> LineClient:
        line = Line(
            name=name,
            opener=opener,
            timing=timing,
            polls=polls,
            events=self._events,
            allowance_s=allowance_s,
            seed=self.seed,
            deaf_after_s=deaf_after_s,
        )
        task = asyncio.create_task(self._run(line, tuple(self._ending)))
        self.lines[name] = (task, line)
        return LineClient(line, post_here)

    def remove_line(self, name: str) -> Coroutine[Any, Any, object]:
        task, line = self.lines.pop(name)
        line.events.is_muted = True
        task.cancel()
        self._ending.add(task)
        task.add_done_callback(self._ending.discard)
        return asyncio.wait((task,))

    async def stop(self) -> None:
        for name in tuple(self.lines):
            await self.remove_line(name)

    async def _run(self, line: Line, earlier: Sequence[asyncio.Task[None]]) -> None:
        if earlier:
            await asyncio.wait(earlier)
        await line.run()


def local_events(handle: Callable[[LineEvent], None]) -> EventQueue:
    """Return the list of a line on the test's own loop, each of whose events is handled at once."""
    return EventQueue(lambda batch: deliver(batch, handle), polls_wait_s=0.0)
