"""What systemd receives from the service: READY once the lines poll, WATCHDOG only while they do, reloads."""

from __future__ import annotations

import asyncio
import signal
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from tests.end_to_end.site import Program, site_config, write_config
from tests.rig.sites import operator

UNUSED_PORT = 9  # a TCP port on which no process listens: no broker


class Service:
    """The gateway with a notification socket [sd_notify(3)]."""

    program: Program
    config: Path

    def __init__(self, manager: socket.socket) -> None:
        self._manager = manager

    async def notifies(self, word: str) -> None:
        loop = asyncio.get_running_loop()
        async with asyncio.timeout(20.0):
            while word not in (await loop.sock_recv(self._manager, 4096)).decode().splitlines():
                pass


@asynccontextmanager
async def service(folder: Path, **environ: str) -> AsyncIterator[Service]:
    """Run simulated starters and the gateway, without a broker; it ends in order, and has no bug."""
    text = site_config(broker_port=UNUSED_PORT, port=str(folder / "ttyHALL"))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(folder / "notify"))
        manager.setblocking(False)
        made = Service(manager)
        made.config = write_config(folder, text)
        environ |= {"NOTIFY_SOCKET": str(folder / "notify")}
        async with Program("gateway", "simulate", str(made.config)) as simulator:
            await simulator.says("line hall")
            async with Program("gateway", "run", str(made.config), environ=environ) as made.program:
                await made.notifies("READY=1")
                yield made
                made.program.signal(signal.SIGTERM)
                await made.notifies("STOPPING=1")
                assert await made.program.exit_code(within_s=10.0) == 0
    assert "Traceback" not in made.program.output


async def test_ready_and_watchdog_come_from_the_lines_work_even_without_a_broker(tmp_path: Path) -> None:
    async with service(tmp_path, WATCHDOG_USEC="1000000") as made:
        for _ in range(2):
            await made.notifies("WATCHDOG=1")


async def test_the_begin_and_the_end_of_a_reload_good_or_bad_are_notified(tmp_path: Path) -> None:
    async with service(tmp_path) as made:
        good = made.config.read_text("utf-8")
        for text in (good + operator("bob"), good.replace("19200", "7")):
            made.config.write_text(text, "utf-8")
            made.program.signal(signal.SIGHUP)
            await made.notifies("RELOADING=1")
            await made.notifies("READY=1")
        await made.program.says("reload refused")
        made.program.signal(signal.SIGHUP)  # and it ends in the middle of it
