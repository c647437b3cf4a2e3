"""Starts a program again and again, as systemd does with the shipped unit [systemd.service(5)]."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import signal
import socket
import sys
import time
from dataclasses import dataclass, field
from math import inf
from pathlib import Path

from gateway.line.capacity.outage import Restart
from tests.lab.torture.blockable import BLOCK_FILE
from tests.lab.torture.machine import until

BAD_CONFIGURATION = 78  # RestartPreventExitStatus
UNIT = Path(__file__).parents[3] / "deploy" / "starter-gateway.service"


def restart_of_unit() -> Restart:
    """Return the times that the shipped unit states."""
    text = UNIT.read_text("utf-8")

    def seconds(key: str) -> float:
        (found,) = re.findall(rf"^{key}=(\d+)(ms|s)$", text, re.MULTILINE)
        return float(found[0]) / (1000.0 if found[1] == "ms" else 1.0)

    return Restart(seconds("RestartSec"), seconds("WatchdogSec"), seconds("TimeoutAbortSec"))


@dataclass
class Life:
    """One run of the process; times are monotonic."""

    began_s: float
    ready_s: float | None = None
    ended_s: float | None = None
    is_hung: bool = False  # ended by the watchdog


@dataclass
class Supervisor:
    """Runs the gateway, or a module that is one, with a configuration, whatever happens to it."""

    module: str
    config: Path
    restart: Restart
    lives: list[Life] = field(default_factory=list)
    _process: asyncio.subprocess.Process | None = None
    _task: asyncio.Task[None] | None = None
    _fed_s: float = 0.0
    _is_ending: bool = False

    @property
    def log_path(self) -> Path:
        return self.config.with_name("supervised.log")

    @property
    def log(self) -> str:
        """Return everything that all lives have written."""
        return self.log_path.read_text("utf-8", "replace") if self.log_path.exists() else ""

    @property
    def pid(self) -> int:
        """Return the present process."""
        assert self._process is not None
        return self._process.pid

    def start(self) -> None:
        """Begin."""
        self._is_ending = False
        self._task = asyncio.create_task(self._supervise())

    async def stop(self) -> None:
        """End the gateway in order, as `systemctl stop`."""
        self._is_ending = True
        self.signal(signal.SIGTERM)
        self.signal(signal.SIGCONT)
        if self._task is not None:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(asyncio.shield(self._task), 12.0)  # TimeoutStopSec
            self.signal(signal.SIGKILL)
            await self._task

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to the present process, if there is one."""
        if self._process is not None and self._process.returncode is None:
            self._process.send_signal(number)

    def block(self, what: str, seconds: float) -> None:
        """Block one of its loops, if it runs as `tests.lab.torture.blockable`."""
        self._block_file.write_text(json.dumps({"what": what, "seconds": seconds}), "utf-8")
        self.signal(signal.SIGUSR1)

    @property
    def _block_file(self) -> Path:
        return self.config.with_name("block.json")

    async def until_up(self, *, lives: int = 1, within_s: float = 30.0) -> None:
        """Wait until that many lives have begun and the last has said READY."""

        def is_up() -> bool:
            last = self.lives[-1] if len(self.lives) >= lives else Life(0.0)
            return last.ready_s is not None and last.ended_s is None

        await until(is_up, "the gateway is up", within_s=within_s)

    async def _supervise(self) -> None:
        while await self._live() != BAD_CONFIGURATION and not self._is_ending:
            await asyncio.sleep(self.restart.restart_s)
            if self._is_ending:
                return

    async def _live(self) -> int:
        """Run the process once and return its exit code."""
        address = f"@torture-{os.getpid()}-{self.config.parent.name}"  # abstract: a path may be too long
        environ = {
            "NOTIFY_SOCKET": address,
            "WATCHDOG_USEC": str(int(self.restart.watchdog_s * 1e6)),
            "PYTHONFAULTHANDLER": "1",
            BLOCK_FILE: str(self._block_file),
        }
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notify, self.log_path.open("ab") as log:
            notify.bind(address.replace("@", "\0", 1))
            notify.setblocking(False)
            life = Life(time.monotonic())
            self.lives.append(life)
            self._process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", self.module, "run", str(self.config)),
                env={**os.environ, **environ},
                stdin=asyncio.subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
            watching = asyncio.create_task(self._watch(notify, life))
            code = await self._process.wait()
            life.ended_s = time.monotonic()
            watching.cancel()
            await asyncio.wait((watching,))
        return code

    async def _watch(self, notify: socket.socket, life: Life) -> None:
        """End a process that has stopped feeding; its stacks are asked for first."""

        def is_starved() -> bool:
            with contextlib.suppress(BlockingIOError):
                while words := notify.recv(4096).decode().splitlines():
                    if "READY=1" in words:
                        life.ready_s = life.ready_s or time.monotonic()
                    if "READY=1" in words or "WATCHDOG=1" in words:
                        self._fed_s = time.monotonic()
            return life.ready_s is not None and time.monotonic() - self._fed_s >= self.restart.watchdog_s

        await until(is_starved, "the watchdog is starved", within_s=inf)
        life.is_hung = True
        self.signal(signal.SIGABRT)
        self.signal(signal.SIGCONT)  # as systemd does, or a stopped process would never receive it
        await asyncio.sleep(self.restart.abort_s)
        self.signal(signal.SIGKILL)
