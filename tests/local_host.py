"""A `gateway.app.plant.Host` whose lines run on the test's own loop, so that time can be virtual."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Sequence
from typing import Any

from gateway.line.client import LineClient, LocalLineClient
from gateway.line.events import LineListener
from gateway.line.line import Line
from gateway.line.loop_bridge import CarriedListener, LoopBridge
from gateway.line.port.base import PortOpener
from gateway.line.scheduler.requests import Poll
from gateway.modbus.timing import LineTiming


class LocalHost:
    """As `LineHost`, without the thread; lines begin as they are added."""

    def __init__(self, listener: LineListener) -> None:
        self._listener = listener
        self._bridge = LoopBridge()
        self._bridge.loop = asyncio.get_running_loop()
        self._lines: dict[str, tuple[asyncio.Task[None], CarriedListener]] = {}
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
        listener = CarriedListener(self._listener, self._bridge)
        scheduler = Line(
            name=name,
            opener=opener,
            timing=timing,
            polls=polls,
            listener=listener,
            allowance_s=allowance_s,
            seed=0,  # not by chance: what differs between two runs must come from what is tested
            deaf_after_s=deaf_after_s,
        )
        task = asyncio.create_task(self._run(scheduler, tuple(self._ending)))
        self._lines[name] = (task, listener)
        return LocalLineClient(scheduler)

    def remove_line(self, name: str) -> Coroutine[Any, Any, object]:
        task, listener = self._lines.pop(name)
        listener.mute()
        task.cancel()
        self._ending.add(task)
        task.add_done_callback(self._ending.discard)
        return asyncio.wait((task,))

    async def stop(self) -> None:
        for name in tuple(self._lines):
            await self.remove_line(name)

    async def _run(self, scheduler: Line, earlier: Sequence[asyncio.Task[None]]) -> None:
        if earlier:
            await asyncio.wait(earlier)
        await scheduler.run()
