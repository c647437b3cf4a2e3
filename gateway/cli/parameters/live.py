"""One starter of a configuration, reached directly through its line's port."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Self

from gateway.app import io
from gateway.cli.command import Progress, place_of
from gateway.config.convert import setups_of, timing_of
from gateway.config.load import load
from gateway.errors import PortError
from gateway.families import Read, reading
from gateway.line import PortOpener, exclusive_line, new_precise_loop, request_wire_s
from gateway.modbus.timing import LineTiming
from gateway.starters import KnownWatchdogs, StarterSetup
from gateway.starters.bulk_read import BulkReading
from gateway.starters.parameters.model import ParameterSet, entries_of
from gateway.starters.parameters.offline_starter import OfflineStarter
from gateway.starters.setup import forms_of
from gateway.system.clock import Clock, SystemClock
from gateway.system.instance_lock import may_use

_HELD = "a gateway or another program holds it"
_STOP_IT = "stop the gateway for the time being: this command needs the port for itself"
_ADU_EXTRA = 3  # bytes around a PDU: unit and CRC


@dataclass(frozen=True, slots=True)
class LiveStarter:
    """Where a starter is."""

    setup: StarterSetup
    opener: PortOpener
    timing: LineTiming
    allowance_s: float
    clock: Clock
    state_dir: Path  # of the gateway, which knows the starter
    neighbours: tuple[StarterSetup, ...] = ()  # all starters of its line

    @classmethod
    def find(cls, config_path: str, name: str) -> Self:
        """Return a starter of a configuration; ConfigError, UsageError when there is none of that name."""
        config = load(config_path)
        line, _ = place_of(config, name)
        setups, timing = setups_of(line), timing_of(line)
        return cls(
            next(each for each in setups if each.name == name),
            io.MACHINE.make_opener(line.port, timing),
            timing,
            line.adapter_allowance_s,
            SystemClock(),
            Path(config_path).parent / config.gateway.state_dir,
            setups,
        )

    @asynccontextmanager
    async def bench(self, watchdogs: KnownWatchdogs | None = None) -> AsyncIterator[OfflineStarter]:
        """Open the port and identify the starter; PortError, CommandError."""
        if not may_use(self.opener.name, self.state_dir):
            raise PortError(self.opener.name, _HELD, _STOP_IT)
        try:
            async with exclusive_line(
                self.setup.line,
                self.opener,
                self.timing,
                allowance_s=self.allowance_s,
                forms=forms_of(self.setup.profile),
            ) as line:
                bench = OfflineStarter(self.setup, line=line, clock=self.clock, watchdogs=watchdogs)
                await bench.identify()
                yield bench
        except PortError as error:
            if error.reason != "busy":
                raise
            raise PortError(error.port, _HELD, _STOP_IT) from error


def save_live(live: LiveStarter, progress: Progress, *, with_unnamed: bool = False) -> ParameterSet:
    """Read a starter's set in real time."""
    with asyncio.Runner(loop_factory=new_precise_loop) as runner:
        return runner.run(save(live, progress, with_unnamed=with_unnamed))


async def save(live: LiveStarter, progress: Progress, *, with_unnamed: bool = False) -> ParameterSet:
    """Read everything from a starter, with a progress line."""
    async with live.bench() as bench:
        codes = reading.readable_codes(bench.profile, with_unnamed=with_unnamed)
        read = await read_with_progress(bench, reading.bulk_reads(bench.profile, codes), progress)
        return ParameterSet(
            starter=live.setup.name,
            family=bench.profile.family,
            taken=datetime.fromtimestamp(live.clock.utc_s(), UTC).isoformat(timespec="seconds"),
            model=bench.variant.model,
            firmware=bench.variant.firmware,
            serial=bench.identity.serial,
            parameters=entries_of(bench.profile, bench.variant, read.rows),
            refused=read.refused,
        )


async def read_with_progress(
    bench: OfflineStarter, reads: tuple[Read, ...], progress: Progress
) -> BulkReading:
    """Carry out many reads, showing the share of their wire time that is done and the time left."""
    loop = asyncio.get_running_loop()
    all_s = sum(wire_s(read, bench.line.timing) for read in reads)
    began_s, done_s = loop.time(), 0.0

    def show(read: Read) -> None:
        nonlocal done_s
        done_s = min(done_s + wire_s(read, bench.line.timing), all_s)
        left_s = (loop.time() - began_s) * (all_s - done_s) / done_s
        progress.show(done_s / all_s, f"{bench.setup.name}: {read.codes[-1]}", left_s=left_s)

    try:
        return await bench.read(reads, on_read=show)
    finally:
        progress.end()


def wire_s(read: Read, timing: LineTiming) -> float:
    """Return how long a read and its reply are on the wire, with the silence before each."""
    reply_size = read.request.reply_size() or 0
    reply_s = timing.wire_s(reply_size + _ADU_EXTRA)
    return request_wire_s(read.request, timing) + reply_s + 2 * timing.silence_s
