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
from collections.abc import Sequence
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
    code: int | None = None
    is_hung: bool = False  # ended by the watchdog


@dataclass
class Supervisor:
    """Runs a command, whatever happens to it."""

    command: Sequence[str]
    restart: Restart
    folder: Path  # of its log
    lives: list[Life] = field(default_factory=list)
    _process: asyncio.subprocess.Process | None = None
    _task: asyncio.Task[None] | None = None
    _fed_s: float = 0.0
    _is_ending: bool = False

    @classmethod
    def of_gateway(cls, config: Path, restart: Restart, *, module: str = "gateway") -> Supervisor:
        """Return one that runs the gateway, or a program that is one, with a configuration."""
        return cls((sys.executable, "-m", module, "run", str(config)), restart, config.parent)

    @property
    def log_path(self) -> Path:
        return self.folder / "supervised.log"

    @property
    def log(self) -> str:
        """Return everything that all lives have written."""
        return self.log_path.read_text("utf-8", "replace") if self.log_path.exists() else ""

    @property
    def pid(self) -> int:
        """Return the present process."""
        assert self._process is not None
        return self._process.pid

    @property
    def is_up(self) -> bool:
        """Return whether the present process has said READY."""
        return bool(self.lives) and self.lives[-1].ready_s is not None and self.lives[-1].ended_s is None

    def start(self) -> None:
        """Begin."""
        self._is_ending = False
        self._task = asyncio.create_task(self._supervise())

    async def stop(self) -> int | None:
        """End the gateway in order, as `systemctl stop`; return its exit code."""
        self._is_ending = True
        self.signal(signal.SIGTERM)
        self.signal(signal.SIGCONT)
        if self._task is not None:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(asyncio.shield(self._task), 12.0)  # TimeoutStopSec
            self.signal(signal.SIGKILL)
            await self._task
        return self.lives[-1].code if self.lives else None

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to the present process, if there is one."""
        if self._process is not None and self._process.returncode is None:
            self._process.send_signal(number)

    def block(self, what: str, seconds: float) -> None:
        """Block one of its loops, if it runs as `tests.lab.torture.blockable`."""
        (self.folder / "block.json").write_text(json.dumps({"what": what, "seconds": seconds}), "utf-8")
        self.signal(signal.SIGUSR1)

    async def until_up(self, *, lives: int = 1, within_s: float = 30.0) -> None:
        """Wait until that many lives have begun and the last is ready."""
        await until(lambda: len(self.lives) >= lives and self.is_up, "the gateway is up", within_s=within_s)

    async def _supervise(self) -> None:
        while not self._is_ending:
            await self._live()
            if self._is_ending or self.lives[-1].code == BAD_CONFIGURATION:
                return
            await asyncio.sleep(self.restart.restart_s)

    async def _live(self) -> None:
        address = f"@torture-{os.getpid()}-{self.folder.name}"  # abstract: a folder's path may be too long
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notify, self.log_path.open("ab") as log:
            notify.bind(address.replace("@", "\0", 1))
            notify.setblocking(False)
            life = Life(time.monotonic())
            self.lives.append(life)
            self._process = await asyncio.create_subprocess_exec(
                *self.command,
                env={**os.environ, **self._environ(address)},
                stdin=asyncio.subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
            watching = asyncio.create_task(self._watch(notify, life))
            life.code = await self._process.wait()
            life.ended_s = time.monotonic()
            watching.cancel()
            await asyncio.wait((watching,))

    def _environ(self, address: str) -> dict[str, str]:
        return {
            "NOTIFY_SOCKET": address,
            "WATCHDOG_USEC": str(int(self.restart.watchdog_s * 1e6)),
            "PYTHONFAULTHANDLER": "1",
            BLOCK_FILE: str(self.folder / "block.json"),
        }

    def _listen(self, notify: socket.socket, life: Life) -> None:
        """Read everything that the gateway has logged until now."""
        with contextlib.suppress(BlockingIOError):
            while words := notify.recv(4096).decode().splitlines():
                if "READY=1" in words:
                    life.ready_s = life.ready_s or time.monotonic()
                if "READY=1" in words or "WATCHDOG=1" in words:
                    self._fed_s = time.monotonic()

    async def _watch(self, notify: socket.socket, life: Life) -> None:
        """End a process that has stopped feeding; its stacks are asked for first."""

        def is_starved() -> bool:
            self._listen(notify, life)
            return life.ready_s is not None and time.monotonic() - self._fed_s >= self.restart.watchdog_s

        await until(is_starved, "the watchdog is starved", within_s=inf)
        life.is_hung = True
        self.signal(signal.SIGABRT)
        self.signal(signal.SIGCONT)  # as systemd does, or a stopped process would never receive it
        await asyncio.sleep(self.restart.abort_s)
        self.signal(signal.SIGKILL)
