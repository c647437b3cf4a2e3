"""The demo's simulated starters: `simulate` in a process of its own, so that they answer on time."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from pathlib import Path

from gateway.errors import PortError

_READY = "knobs:"  # how the last line that it prints begins
_START_TIMEOUT_S = 20.0


class DemoSimulator:
    """The simulated starters of a configuration, their knobs at a broker on loopback."""

    def __init__(self, config: Path, *, broker_port: int) -> None:
        self._config = config
        self._broker = f"mqtt://127.0.0.1:{broker_port}"
        self._process: asyncio.subprocess.Process | None = None

    async def start(self) -> None:
        """Start and wait until the line is there; PortError when it does not come."""
        command = ("-m", "gateway", "simulate", str(self._config), "--knobs", self._broker, "--companion")
        self._process = process = await asyncio.create_subprocess_exec(
            sys.executable,
            *command,
            stdin=asyncio.subprocess.PIPE,  # closed when we are killed, which ends it too
            stdout=asyncio.subprocess.PIPE,
            start_new_session=True,
        )
        assert process.stdout is not None
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_START_TIMEOUT_S):
                while line := await process.stdout.readline():
                    if line.decode().startswith(_READY):
                        return
        await self.stop()
        raise PortError("of the demo", "the simulated starters do not start", "see their output above")

    async def stop(self) -> None:
        """End the process."""
        if self._process is None:
            return
        with contextlib.suppress(ProcessLookupError):
            self._process.terminate()
        try:
            await asyncio.wait_for(self._process.wait(), 5.0)
        except TimeoutError:
            self._process.kill()
            await self._process.wait()
        self._process = None
