"""The processes of a fleet's gateways."""

from __future__ import annotations

import asyncio
import signal
from contextlib import AsyncExitStack
from pathlib import Path

from tests.end_to_end.site import Program

END_S = 20.0


class Box:
    """One gateway and the simulator of its starters."""

    def __init__(self, name: str, config: Path) -> None:
        self.name = name
        self.restarts = 0
        self._config = config
        self._simulator = Program("gateway", "simulate", str(config))
        self._gateway: Program | None = None
        self._stack = AsyncExitStack()

    async def __aenter__(self) -> Box:
        await self._stack.enter_async_context(self._simulator)
        await self._simulator.says("line hall")
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._stack.aclose()

    @property
    def pids(self) -> tuple[int, int]:
        """Return the process ids of the gateway and of the simulator."""
        assert self._gateway is not None
        return self._gateway.pid, self._simulator.pid

    async def start(self) -> None:
        """Start the gateway."""
        self._gateway = await self._stack.enter_async_context(Program("gateway", "run", str(self._config)))

    async def end(self, how: signal.Signals) -> int:
        """End the gateway and return its exit code."""
        assert self._gateway is not None
        self._gateway.signal(how)
        return await self._gateway.exit_code(within_s=END_S)

    async def restart(self, how: signal.Signals) -> int:
        """End the gateway and start it again; return the exit code of the first run."""
        code = await self.end(how)
        await asyncio.sleep(0.5)
        await self.start()
        self.restarts += 1
        return code

    def output(self) -> str:
        """Return what the present run of the gateway has logged."""
        return "" if self._gateway is None else self._gateway.output
