"""What is promised of commands, tried whole: kills, floods, stale commands and stalled ways."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.lab.torture.command_site import CommandSite, command_site
from tests.lab.torture.of_flood import flood
from tests.lab.torture.of_kills import kills, stops_at_start_up
from tests.lab.torture.of_stale import stale, stalled
from tests.lab.torture.scenario import Row


@dataclass(frozen=True)
class Proof:
    """A promise, and how to try it on a site of its own."""

    name: str
    prove: Callable[[CommandSite, int, int], Awaitable[None]]  # site, how much, seed
    whole: int
    short: int
    unit: str  # of the count
    every_s: float = 0.2  # of the polls; more often than this line can
    mqtt: str = "auto"  # the version that the gateway speaks

    def row(self, count: int, seed: int) -> Row:
        """Try it and return what came of it."""
        with TemporaryDirectory(prefix="torture-commands-", ignore_cleanup_errors=True) as folder:
            return asyncio.run(self.on_site(Path(folder), count, seed))

    async def on_site(self, folder: Path, count: int, seed: int) -> Row:
        """Try it in a folder."""
        begun_s = time.monotonic()
        async with command_site(folder, every_s=self.every_s, mqtt=self.mqtt) as site:
            try:
                await self.prove(site, count, seed)
            except TimeoutError as error:
                site.check(False, str(error) or "something never came about")
        took_s = time.monotonic() - begun_s
        return Row(self.name, f"{count} {self.unit}", site.failures, site.measurements, took_s)


KILLS = Proof("SIGKILL around a start", kills, 200, 8, "times")
STOPS = Proof("stop at start-up", stops_at_start_up, 50, 3, "times")
FLOOD = Proof("flood of commands", flood, 60, 5, "s", every_s=1.0)  # a period that the line can keep
STALE = Proof("stale commands", stale, 100, 5, "each")
STALLED = Proof("stalled ways", stalled, 60, 6, "s at most")
STALLED_OLD = Proof("stalled, MQTT 3.1.1", stalled, 60, 6, "s at most", mqtt="3.1.1")
SCENARIOS = (KILLS, STOPS, FLOOD, STALE, STALLED, STALLED_OLD)
