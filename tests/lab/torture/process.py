"""The starters' process seen from the harness, and what Linux knows of a process."""

from __future__ import annotations

import asyncio
import json
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

LOOKS, LOOK_EVERY_S = 5, 0.02
TICKS_PER_S = os.sysconf("SC_CLK_TCK")


class Starters:
    """Runs `tests.lab.torture.starters`, or a module like it, and gives it orders."""

    def __init__(self, config: Path, watchdog_s: int, *, module: str = "tests.lab.torture.starters") -> None:
        self._arguments = (module, str(config), str(watchdog_s))
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


@dataclass(frozen=True)
class Sample:
    """What a process uses."""

    rss_kb: int
    files: int
    threads: int
    cpu_s: float


def _files(pid: int) -> int:
    """Return how many files are open, a moment after the last look: one that is being written goes again."""
    time.sleep(LOOK_EVERY_S)
    return len(os.listdir(f"/proc/{pid}/fd"))


def sample(pid: int) -> Sample:
    """Return what a process uses now; OSError when it is gone."""
    status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text("utf-8").splitlines())
    fields = Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()
    return Sample(
        rss_kb=int(status["VmRSS"].split()[0]),
        files=min(_files(pid) for _ in range(LOOKS)),
        threads=int(status["Threads"]),
        cpu_s=(int(fields[11]) + int(fields[12])) / TICKS_PER_S,
    )
