"""What a scrape of 247 starters costs: `python -m tests.lab.bench.metrics`, half a minute.

Its time in the thread, the delays of a loop beside it, its size, and the memory that it takes.
"""

from __future__ import annotations

import asyncio
import gc
import gzip
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from gateway.families.profile.load import load_profile
from gateway.line.thread import SWITCH_INTERVAL_S
from gateway.metrics.scrape import MetricsSettings, ScrapedGateway, ScrapedLine, ScrapedStarter
from gateway.starters.telemetry.decoding import unit_of
from gateway.system.clock import SystemClock
from gateway.system.gc_tuning import THRESHOLDS
from tests.metrics.support import LINE, UNIT, good, scraped_gateway, scraped_starter

T = TypeVar("T")

STARTERS = 247
SCRAPES = 20
TICK_S = 0.001
FAMILIES = ("ssw06", "ssw07", "ssw900", "sst")


def starter(address: int) -> ScrapedStarter:
    profile = load_profile(FAMILIES[address % len(FAMILIES)])
    readings = {
        name: good(float(address), unit_of(profile, name), time_s=time.time()) for name in profile.points
    }
    made = scraped_starter(f"pump-{address}", family=profile.family, address=address)
    return replace(made, readings=readings)


class LargeSite:
    def __init__(self) -> None:
        starters = [starter(address) for address in range(1, STARTERS + 1)]
        unit = {**UNIT, "response_time_s": {"p50": 0.01, "p99": 0.02}}
        line = {**LINE, "units": {each.address: unit for each in starters}}
        self._gateway = scraped_gateway(*starters, lines=(ScrapedLine("pumps", line),))

    def scraped(self) -> ScrapedGateway:
        return replace(self._gateway)


def rss_mib() -> float:
    fields = Path("/proc/self/status").read_text("ascii").split("VmRSS:")[1].split()
    return int(fields[0]) / 1024


async def delays_of_loop(going_on: asyncio.Event) -> list[float]:
    """Return by how much each tick was late until the event, without what other processes took."""
    delays = []
    while not going_on.is_set():
        due_s, held_s = time.monotonic() + TICK_S, held_up_s()
        await asyncio.sleep(TICK_S)
        delays.append(max(time.monotonic() - due_s - (held_up_s() - held_s), 0.0))
    return delays


def held_up_s() -> float:
    """Return for how long threads of this process were ready to run and did not [sched-stats.rst]."""
    texts = (each.read_text("ascii") for each in Path("/proc/self/task").glob("*/schedstat"))
    return sum(int(text.split()[1]) for text in texts) / 1e9


async def measure(*, has_all_points: bool) -> None:
    from gateway.metrics.service import MetricsService

    busy_s: list[float] = []

    def timed(work: Callable[[], T]) -> T:
        began_s = time.thread_time()
        try:
            return work()
        finally:
            busy_s.append(time.thread_time() - began_s)

    async def in_thread(work: Callable[[], T], /) -> T:
        return await asyncio.to_thread(timed, work)

    settings = MetricsSettings(has_all_points=has_all_points)
    service = MetricsService(
        settings,
        LargeSite(),
        SystemClock(),
        verbs=frozenset(),
        on_trouble=lambda _: None,
        in_thread=in_thread,
    )
    await asyncio.to_thread(gc.collect)
    before_mib = rss_mib()
    delays: list[float] = []
    text = b""
    for _ in range(SCRAPES):
        service.move(settings)  # the text of before counts no more
        done = asyncio.Event()
        ticking = asyncio.create_task(delays_of_loop(done))
        await asyncio.sleep(0.01)
        text = await service.text()
        done.set()
        delays += await ticking
    series = sum(not line.startswith(b"#") for line in text.splitlines())
    size, small = len(text) / 1024, len(gzip.compress(text, 1)) / 1024
    print(f"all_points={has_all_points}: {series} series, {size:.0f} KiB, {small:.0f} KiB compressed")
    print(f"  processor time of a scrape: {milliseconds(busy_s)}")
    print(f"  lateness of the loop beside it: {milliseconds(delays)}")
    print(f"  memory: +{rss_mib() - before_mib:.1f} MiB")


def milliseconds(times_s: list[float]) -> str:
    return f"{statistics.median(times_s) * 1000:.2f} ms, at most {max(times_s) * 1000:.1f}"


async def quiet() -> None:
    """Show what the machine itself does to a loop."""
    done = asyncio.Event()
    asyncio.get_running_loop().call_later(2.0, done.set)
    delays = await delays_of_loop(done)
    print(f"lateness of a loop without a scrape: {milliseconds(delays)}")


async def main() -> None:
    before_mib = rss_mib()
    import gateway.metrics.service  # noqa: F401 - its memory is measured

    print(f"import: +{rss_mib() - before_mib:.1f} MiB")
    await quiet()
    await measure(has_all_points=False)
    await measure(has_all_points=True)


if __name__ == "__main__":
    sys.setswitchinterval(SWITCH_INTERVAL_S)  # as in the gateway, whose long-lived objects are frozen, too
    gc.set_threshold(*THRESHOLDS)
    gc.freeze()
    asyncio.run(main())
