"""What issue-sized promises about commands are worth: kills, floods, stale and malformed commands.

Also by itself: `python -m tests.lab.torture.of_commands [--short] [--seed N] [NAME..]`.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.lab.torture.command_site import CommandSite, ResultListener, command_site
from tests.lab.torture.of_flood import flood
from tests.lab.torture.of_kills import kills, stops_at_start_up
from tests.lab.torture.of_malformed import malformed_in_process, malformed_through_broker
from tests.lab.torture.of_model import histories
from tests.lab.torture.of_stale import stale, stale_to_old, stalled
from tests.lab.torture.of_stops import second_stops, stops_in_a_large_flood
from tests.lab.torture.scenario import Row
from tests.lab.torture.scratch import scratch


@dataclass(frozen=True)
class Proof:
    """A promise, and how to try it on a site of its own."""

    name: str
    prove: Callable[[CommandSite, int, int], Awaitable[None]]  # site, how much, seed
    whole: int
    short: int
    unit: str  # of the count
    every_s: float = 0.2  # of the polls; more often than this line can
    is_old: bool = False  # the broker speaks MQTT 3.1.1 only
    make_listener: Callable[[int], ResultListener] = ResultListener  # of the broker's port

    def row(self, count: int, seed: int) -> Row:
        """Try it and return what came of it."""
        with scratch("torture-commands-") as folder:
            return asyncio.run(self.on_site(folder, count, seed))

    async def on_site(self, folder: Path, count: int, seed: int) -> Row:
        """Try it in a folder."""
        begun_s = time.monotonic()
        options: dict[str, Any] = {"is_old": self.is_old, "make_listener": self.make_listener}
        async with command_site(folder, every_s=self.every_s, **options) as site:
            try:
                await self.prove(site, count, seed)
            except TimeoutError as error:
                site.check(False, str(error) or "something never came about")
        took_s = time.monotonic() - begun_s
        return Row(self.name, f"{count} {self.unit}", site.failures, site.measurements, took_s)


@dataclass(frozen=True)
class PureProof:
    """A promise that needs no site."""

    name: str
    prove: Callable[[int, int], tuple[list[str], dict[str, int]]]
    whole: int
    short: int
    unit: str

    def row(self, count: int, seed: int) -> Row:
        """Try it and return what came of it."""
        begun_s = time.monotonic()
        failures, measurements = self.prove(count, seed)
        return Row(self.name, f"{count} {self.unit}", failures, measurements, time.monotonic() - begun_s)


KILLS = Proof("SIGKILL around a start", kills, 200, 8, "times")
FLOOD = Proof("flood of commands", flood, 60, 5, "s", every_s=1.0)  # a period that the line can keep
STOPS = Proof("stop at start-up", stops_at_start_up, 50, 3, "times")
LARGE_FLOOD = Proof("stops in a flood of 4 KB", stops_in_a_large_flood, 30, 4, "stops", every_s=1.0)
SECOND_STOPS = Proof("second stops", second_stops, 300, 10, "times", every_s=1.0)
STALE = Proof("stale commands", stale, 100, 5, "each")
STALE_OLD = Proof("stale, gateway on 3.1.1", stale_to_old, 100, 5, "each", is_old=True)
STALLED = Proof("stalled ways", stalled, 60, 6, "s at most")
STALLED_OLD = Proof("stalled, gateway on 3.1.1", stalled, 60, 6, "s at most", is_old=True)
MALFORMED = Proof("malformed, by broker", malformed_through_broker, 200, 40, "payloads")
HISTORIES = PureProof("histories of commands", histories, 2_000, 50, "histories")
MALFORMED_PURE = PureProof("malformed, in process", malformed_in_process, 100_000, 5_000, "payloads")
SCENARIOS: tuple[Proof | PureProof, ...] = (
    KILLS,
    STOPS,
    FLOOD,
    LARGE_FLOOD,
    SECOND_STOPS,
    STALE,
    STALE_OLD,
    STALLED,
    STALLED_OLD,
    MALFORMED,
    MALFORMED_PURE,
    HISTORIES,
)


def main() -> int:
    """Run these alone."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int)
    args = parser.parse_args()
    is_bad = False
    for each in SCENARIOS:
        if args.names and not any(each.name.startswith(name) for name in args.names):
            continue
        row = each.row(args.count or (each.short if args.short else each.whole), args.seed)
        print("\n    ".join([str(row), *row.failures]), flush=True)
        is_bad = is_bad or bool(row.failures)
    return int(is_bad)


if __name__ == "__main__":
    sys.exit(main())
