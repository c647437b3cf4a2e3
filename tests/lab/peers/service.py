"""Runs a contender as a service manager would: whenever it ends, it is started again."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections.abc import Mapping, Sequence
from pathlib import Path

PATIENCE_S = 12.0  # TimeoutStopSec


class Service:
    """One command, restarted when it ends."""

    def __init__(
        self, command: Sequence[str], log: Path, *, restart_s: float, environ: Mapping[str, str] | None = None
    ) -> None:
        self.lives = 0
        self._command = command
        self._log = log
        self._restart_s = restart_s
        self._environ = {**os.environ, **(environ or {})}
        self._process: asyncio.subprocess.Process | None = None
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        self._task = asyncio.create_task(self._keep_alive())

    def kill(self) -> None:
        """Let it die as it stands; it is started again."""
        self._signal(signal.SIGKILL)

    async def stop(self) -> None:
        """End it, and leave it so."""
        if self._task is None:
            return
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task
        self._task = None
        if self._process is not None:
            self._signal(signal.SIGTERM)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._process.wait(), PATIENCE_S)
            self._signal(signal.SIGKILL)
            await self._process.wait()

    async def _keep_alive(self) -> None:
        while True:
            with self._log.open("ab") as log:
                self._process = await asyncio.create_subprocess_exec(
                    *self._command,
                    env=self._environ,
                    stdin=asyncio.subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                )
            self.lives += 1
            await self._process.wait()
            await asyncio.sleep(self._restart_s)

    def _signal(self, number: signal.Signals) -> None:
        if self._process is not None and self._process.returncode is None:
            self._process.send_signal(number)
