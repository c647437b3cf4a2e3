"""`starter-gateway simulate`: the starters of a configuration, simulated on pseudo-terminals in real time."""

from __future__ import annotations

import argparse
import asyncio
import signal
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

from gateway.commands.command import Subparsers
from gateway.config.load import load
from gateway.config.schema import Config, LineTable
from gateway.config.setups import timing_of
from gateway.sim.bus import Bus
from gateway.sim.factory import make_unit
from gateway.sim.pty import PtyLine

TOLERANCE_S = 0.0002  # two programs never wake on the spot


def add_parser(subparsers: Subparsers) -> None:
    """Add the command's parser."""
    parser = subparsers.add_parser(
        "simulate",
        description="Simulate the starters of a configuration, with real byte times, on pseudo-terminals."
        " A port that does not exist yet is made (a link), so that `run` works with the same configuration.",
    )
    parser.add_argument("config", metavar="CONFIG", help="the site's TOML file")


def run(args: argparse.Namespace) -> int:
    """Simulate until SIGTERM or Ctrl-C."""
    asyncio.run(_simulate(load(args.config)))
    return 0


@asynccontextmanager
async def simulated_lines(config: Config) -> AsyncIterator[dict[str, PtyLine]]:
    """Serve every line of a configuration on a pty; by name. PortError when a port's link cannot be made."""
    async with AsyncExitStack() as stack:
        lines: dict[str, PtyLine] = {}
        for table in config.lines:
            line = PtyLine(_bus(table), link=_link(table))
            await line.start()
            stack.push_async_callback(line.stop)
            lines[table.name] = line
        yield lines


async def _simulate(config: Config) -> None:
    ending = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, ending.set)
    async with simulated_lines(config) as lines:
        for table in config.lines:
            units = ", ".join(f"{each.name} ({each.family} at {each.address})" for each in table.starters)
            link = _link(table)
            way = f"{link} -> {lines[table.name].path}" if link is not None else lines[table.name].path
            print(f"line {table.name}: {way}, {table.baud} {table.framing}: {units}", flush=True)
        await ending.wait()


def _bus(table: LineTable) -> Bus:
    units = [
        make_unit(starter.family, starter.address, seed=starter.address, model=starter.model)
        for starter in table.starters
        if starter.enabled
    ]
    return Bus(timing_of(table), units, name=table.name, chunk_bytes=None, tolerance_s=TOLERANCE_S)


def _link(table: LineTable) -> Path | None:
    """Return where to link the pty to: the line's port, unless something real stands there."""
    path = Path(table.port)
    if "://" in table.port or (path.exists() and not path.is_symlink()):
        return None
    if path.is_symlink() and not str(path.readlink()).startswith("/dev/pts/"):
        return None  # a stable name of a real adapter
    return path
