"""How fast this machine is, what it holds, and whether a site needs more; for `doctor` and `check`."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

from gateway.app.capacity import LineCapacity
from gateway.config.convert import timing_of
from gateway.errors import DamagedError, NewerError, StoreError
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.schema import Profile, Variant
from gateway.families.reading import plan_blocks
from gateway.line.capacity.processor import (
    FULL_STARTERS,
    FULL_TIMING,
    HELD_SHARE,
    LineDemand,
    demand_of,
    full_lines_held,
    processor_share,
)
from gateway.modbus import adu
from gateway.mqtt.contract.payloads import ValueTexts
from gateway.mqtt.contract.topics import Topics
from gateway.records import Quality, ValueRecord
from gateway.starters.telemetry.decoding import sources_of, units_of
from gateway.storage.json_file import JsonFile

BOX_FILE = "box.json"  # in state_dir

ROUND_S = 0.000617  # of the work, where slowness is 1: the machine of docs/performance.md
WINDOWS, WINDOW_S = 6, 0.1  # of the work; the best counts: a program that runs for a moment is left out
TIMERS, TIMER_S = 60, 0.004
SYNCS, SYNC_BYTES = 5, 4096


@dataclass(frozen=True, slots=True)
class BoxSpeed:
    """A machine's measurement."""

    slowness: float  # so many times as long as the machine of docs/performance.md takes
    processor: float  # the share of a processor that this process got meanwhile: less when others work
    timer_late_s: float  # the median of its waits' lateness,
    timer_worst_s: float  # and the worst
    sync_s: float | None  # the longest of some writes to state_dir that wait for the disk; None: not possible
    time_s: float  # when that was

    @property
    def day(self) -> str:
        """Return when it was measured."""
        return time.strftime("%Y-%m-%d", time.gmtime(self.time_s))

    @classmethod
    def load(cls, state_dir: Path) -> Self | None:
        """Return what was measured last; None when nothing was, or it cannot be read."""
        try:
            return cls(**JsonFile(state_dir / BOX_FILE).load() or {})
        except (DamagedError, NewerError, TypeError):
            return None

    def store(self, state_dir: Path) -> str:
        """Store it for `check` where there is a state_dir; return why that failed, else an empty text."""
        if not os.path.isdir(state_dir):  # Path.is_dir() raises where it may not look
            return ""
        try:
            JsonFile(state_dir / BOX_FILE).write(asdict(self))
        except StoreError as error:
            return str(error)
        return ""


async def measured(state_dir: Path) -> BoxSpeed:
    """Measure this machine; nothing may run beside it on this loop."""
    work = _work()
    work(0)  # caches are filled
    slowness, processor = slowness_of(work)
    late_s = sorted([await _lateness_s() for _ in range(TIMERS)])
    return BoxSpeed(
        slowness=round(slowness, 3),
        processor=round(processor, 3),
        timer_late_s=round(late_s[len(late_s) // 2], 6),
        timer_worst_s=round(late_s[-1], 6),
        sync_s=_sync_s(state_dir),
        time_s=round(time.time(), 3),
    )


def slowness_of(
    work: Callable[[int], None],
    *,
    clock: Callable[[], float] = time.perf_counter,
    processor: Callable[[], float] = time.process_time,
) -> tuple[float, float]:
    """Return how long a round takes at best, others' work included, and the share of a processor then."""

    def window() -> tuple[float, float]:
        rounds, begun_s, used_s = 0, clock(), processor()
        while (elapsed_s := clock() - begun_s) < WINDOW_S:
            rounds += 1
            work(rounds)
        return elapsed_s / max(rounds, 1) / ROUND_S, min((processor() - used_s) / elapsed_s, 1.0)

    return min(window() for _ in range(WINDOWS))


def _work() -> Callable[[int], None]:
    """Return a round: requests and replies of each family's status and values, from words to JSON."""
    texts = ValueTexts(Topics("starters/doctor"), "0" * 16)
    starters = [_work_of(load_profile(family), texts) for family in FAMILIES]

    def round_(number: int) -> None:
        for one in starters:
            one(number)

    return round_


def _work_of(profile: Profile, texts: ValueTexts) -> Callable[[int], None]:
    variant, sources, units = Variant(), sources_of(profile), units_of(profile)
    blocks = [block for block in plan_blocks(profile, variant) if block.group != "slow"]

    def one(number: int) -> None:
        for block in blocks:
            request = block.request
            adu.decode(adu.encode(1, request.encode()))
            size = request.reply_size()
            content = bytes((number + at) & 0x0F for at in range((size or 2) - 2))
            reply = adu.encode(1, bytes((request.encode()[0], len(content))) + content)
            words = request.decode_reply(adu.decode(reply).pdu)
            rows = block.rows_in(profile, words)
            for name, decoded in sources.decode(variant, rows, known={}).points.items():
                texts.of(
                    ValueRecord("doctor", name, decoded.value, units[name], Quality.GOOD, number, number)
                )

    return one


async def _lateness_s() -> float:
    """Return how much too late a wait ends that is as long as those of a line."""
    due_s = time.perf_counter() + TIMER_S
    await asyncio.sleep(TIMER_S)
    return max(time.perf_counter() - due_s, 0.0)


def _sync_s(state_dir: Path) -> float | None:
    """Return the longest of some writes that wait for the disk, as the command ledger does."""
    path = state_dir / f"{BOX_FILE}.probe"
    longest_s = 0.0
    try:
        with path.open("wb") as file:
            for _ in range(SYNCS):
                begun_s = time.perf_counter()
                file.write(bytes(SYNC_BYTES))
                file.flush()
                os.fsync(file.fileno())
                longest_s = max(longest_s, time.perf_counter() - begun_s)
    except OSError:
        return None
    finally:
        with suppress(OSError):
            path.unlink()
    return round(longest_s, 6)


def demands_of(prospects: Iterable[LineCapacity]) -> tuple[LineDemand, ...]:
    """Return what the lines of a site ask of the processor."""
    return tuple(
        demand_of(line.forecast, timing_of(line.table), starters=len(line.starters)) for line in prospects
    )


def capacity(speed: BoxSpeed, demands: Iterable[LineDemand]) -> str:
    """Return what the machine holds, and how much of it the site takes at most."""
    held = full_lines_held(slowness=speed.slowness)
    lines = f"{held or 'no'} {'line' if held == 1 else 'lines'} of {FULL_STARTERS} starters"
    share = processor_share(demands, slowness=speed.slowness)
    full = f"{lines} at {FULL_TIMING.baud}, asked without a pause"
    return f"holds {full}; this site takes {share:.0%} of a processor"


def excess(speed: BoxSpeed, demands: Iterable[LineDemand]) -> str:
    """Return by how much the site is more than the machine holds, with a remedy; else an empty text."""
    share = processor_share(demands, slowness=speed.slowness)
    if share <= HELD_SHARE:
        return ""
    what = f"this site takes {share:.0%} of a processor of this machine, which holds up to {HELD_SHARE:.0%}"
    return f"{what} (a faster machine, a longer every_s, or lines on another gateway)"
