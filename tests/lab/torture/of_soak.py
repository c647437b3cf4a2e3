"""A long time of everything, in real time: does anything grow?"""

from __future__ import annotations

import asyncio
import time

from tests.lab.torture.of_broker import AGAIN_S
from tests.lab.torture.scenario import Place, Scenario
from tests.lab.torture.world import World

WARM_UP = 0.3  # of the time
START_EVERY_S = 180.0  # more often, and the motor's overload trips
JUDGED_FROM_S = 600  # less says nothing of growth
GROWTH_KB_PER_H = 1024.0


async def soak(w: World, seconds: int) -> None:
    """Start, stop, trip and reset motors, and take the broker away now and then."""
    begun_s = time.monotonic()
    used: list[tuple[float, int]] = []
    w.sample()
    start_due_s = 0.0
    while (passed_s := time.monotonic() - begun_s) < seconds:
        if passed_s >= start_due_s:
            start_due_s = passed_s + START_EVERY_S
            w.begin_start("fan")
            await asyncio.sleep(1.5)
            await w.stop("fan")
        await _something(w)
        used.append((passed_s, w.sample().rss_kib))
    await w.right(since_s=begun_s, within_s=AGAIN_S)
    w.sample()
    settled = [each for each in used if each[0] >= WARM_UP * seconds]
    hours = max(settled[-1][0] - settled[0][0], 1.0) / 3600.0
    growth = (settled[-1][1] - settled[0][1]) / hours
    w.measurements |= {"growth KB/h": round(growth), "RSS KB": used[-1][1]}
    await w.check_line_timing("somebody had to wait longer than computed")
    if seconds >= JUDGED_FROM_S:
        w.check(growth < GROWTH_KB_PER_H, f"memory grows by {growth:.0f} KB in an hour")


async def _something(w: World) -> None:
    match w.dice.randrange(3):
        case 0:
            await asyncio.to_thread(w.broker.kill)
            await asyncio.sleep(w.dice.uniform(0.0, 2.0))
            back_s = time.monotonic()
            await asyncio.to_thread(w.broker.start)
            await w.right(since_s=back_s, within_s=AGAIN_S)
        case 1:
            await w.starters.order("fault", starter="mill", number=5)
            await asyncio.sleep(1.0)
            await w.starters.order("keypad_reset", starter="mill")
        case _:
            await asyncio.sleep(3.0)


SCENARIOS = (Scenario("soak, real", Place.CRASH, soak, 1800, 5, "s"),)
