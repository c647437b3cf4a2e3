"""A reload of as many starters as a line can have: how long it keeps the gateway's loops from their work."""

from __future__ import annotations

import asyncio
import logging
import os
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from gateway.app.gateway import App
from gateway.app.parts import Parts
from gateway.app.reload import Reload
from gateway.app.site import Site
from gateway.system.systemd import Notifier
from tests.lab.torture.scenario import Row

STARTERS = 247
FAMILIES = ("ssw06", "ssw07", "ssw900", "sst")
LONGEST_S = 1.0  # that the gateway's own loop may stand still
TICK_S = 0.005
SETTLED_S = 5.0


def site_text(folder: Path, *changes: tuple[str, str]) -> str:
    """Return a site with two lines: one full, one with a few starters."""
    lines = ""
    for name, count in (("full", STARTERS), ("few", 4)):
        lines += f'[[line]]\nname = "{name}"\nport = "{folder}/tty-{name}"\nbaud = 19200\nframing = "8N2"\n'
        for address in range(1, count + 1):
            family = FAMILIES[address % len(FAMILIES)]
            lines += (
                f'[[line.starter]]\nname = "{name}-{address}"\naddress = {address}\n'
                f'family = "{family}"\nevery_s = 10.0\n'
            )
    text = (
        f'[gateway]\nname = "big"\nstate_dir = "{folder}/state"\n[mqtt]\nurl = "mqtt://127.0.0.1:9"\n{lines}'
        '[[operator]]\nclient = "alice"\nmay = ["*"]\nstarters = ["*"]\n'
    )
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


CHANGES = {
    "rights": ('may = ["*"]', 'may = ["stop"]'),
    "one starter": ('name = "full-7"', 'name = "full-7b"'),
    "all starters": ("every_s = 10.0", "every_s = 10.0\nresponse_time_s = 0.2"),
}


@asynccontextmanager
async def simulators(path: Path) -> AsyncIterator[None]:
    """Run the starters in a process of their own."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "gateway", "simulate", str(path)), stdout=asyncio.subprocess.DEVNULL
    )
    try:
        yield
    finally:
        process.terminate()
        await process.wait()


class _EndOfReload:
    """Waits for the end of a reload in systemd's place."""

    def __init__(self) -> None:
        self.is_over = asyncio.Event()

    def reloading(self) -> None:
        self.is_over.clear()

    def ready(self, status: str) -> None:
        self.is_over.set()


@dataclass(frozen=True)
class BigReload:
    """Rights, one starter and all starters are changed, one after the other; no broker."""

    name: str = "reload, 247 starters"
    whole: int = 9
    short: int = 3
    quick: int = 0

    def row(self, count: int, seed: int) -> Row:
        """Change so often and judge."""
        row = Row(self.name, f"{count} times")
        began_s = time.monotonic()
        logging.disable(logging.CRITICAL)
        try:
            with tempfile.TemporaryDirectory(prefix="torture-big-") as folder:
                asyncio.run(self._run(row, count, Path(folder)))
        finally:
            logging.disable(logging.NOTSET)
        row.took_s = time.monotonic() - began_s
        return row

    async def _run(self, row: Row, count: int, folder: Path) -> None:
        path = folder / "site.toml"
        path.write_text(site_text(folder), "utf-8")
        site = Site.read(path, {})
        ending: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        async with simulators(path):
            app = App(Parts(site, notifier=Notifier({})))
            running = asyncio.create_task(app.run(ending))
            await asyncio.sleep(SETTLED_S)
            end = _EndOfReload()
            reload = Reload(lambda: Site.read(path, os.environ), app, end)  # type: ignore[arg-type] # as it is used
            for number in range(count):
                what = tuple(CHANGES)[number % len(CHANGES)]
                path.write_text(site_text(folder, CHANGES[what]), "utf-8")
                await self._measured(row, what, reload, end)
                path.write_text(site_text(folder), "utf-8")
                await self._measured(row, f"{what}, back", reload, end)
            ending.set_result("done")
            await running
        if max(row.measurements.values()) > LONGEST_S:
            row.failures.append("a reload blocked the gateway's own loop for too long")

    async def _measured(self, row: Row, what: str, reload: Reload, end: _EndOfReload) -> None:
        """Reload and note the longest time for which the loop did nothing else."""
        ticking = asyncio.create_task(_longest_stall_s(end))
        await asyncio.sleep(10 * TICK_S)
        end.is_over.clear()
        reload.begin()
        stalled_s = await ticking
        row.measurements[what] = max(row.measurements.get(what, 0.0), round(stalled_s, 3))
        await asyncio.sleep(1.0)


async def _longest_stall_s(end: _EndOfReload) -> float:
    loop, longest_s = asyncio.get_running_loop(), 0.0
    end.is_over.clear()
    while not end.is_over.is_set():
        due_s, held_s = loop.time() + TICK_S, _held_s()
        await asyncio.sleep(TICK_S)
        longest_s = max(longest_s, loop.time() - due_s - (_held_s() - held_s))
    return longest_s


def _held_s() -> float:
    """Return for how long this thread has been ready to run and did not, for want of a processor."""
    return int(Path("/proc/thread-self/schedstat").read_text("ascii").split()[1]) / 1e9


SCENARIOS = (BigReload(),)
