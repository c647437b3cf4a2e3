"""The starters' process seen from the harness."""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path
from typing import Any


class Starters:
    """Runs `tests.lab.torture.starters` and gives it orders."""

    def __init__(self, config: Path, watchdog_s: int) -> None:
        self._arguments = ("tests.lab.torture.starters", str(config), str(watchdog_s))
        self._process: asyncio.subprocess.Process | None = None

    async def start(self) -> None:
        self._process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", *self._arguments),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            limit=2**26,
        )
        await self._answer()

    async def order(self, do: str, **arguments: Any) -> dict[str, Any]:
        assert self._process is not None
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"do": do, **arguments}).encode() + b"\n")
        return await self._answer()

    async def stop(self) -> None:
        if self._process is not None and self._process.returncode is None:
            self._process.terminate()
            await self._process.wait()

    async def _answer(self) -> dict[str, Any]:
        assert self._process is not None
        assert self._process.stdout is not None
        async with asyncio.timeout(20.0):
            line = await self._process.stdout.readline()
        answer: dict[str, Any] = json.loads(line)
        return answer
