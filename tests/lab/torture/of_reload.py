"""The configuration is read again under load, good and bad, as often as one likes."""

from __future__ import annotations

import asyncio
import signal
import time

from tests.lab.torture.scenario import Place, Scenario
from tests.lab.torture.world import World

OVER_WITHIN_S = 10.0
EVENTS = ("reloaded", "reload_refused")
ABSENT = '\n[[line.starter]]\nname = "absent"\naddress = 9\nfamily = "ssw07"\n'  # never answers
RIGHTS = '\n[[operator]]\nclient = "bob"\nmay = ["read"]\nstarters = ["*"]\n'


async def reload(w: World, count: int) -> None:
    """Change rights, periods, and another starter of the line; every third file is bad. A motor runs."""
    good = w.gateway.config.read_text("utf-8")
    belt = good.index('name = "belt"')
    paced = good[:belt] + good[belt:].replace("every_s = 1.0", "every_s = 2.0", 1)
    (end, operators) = good.split("\n[[operator]]", 1)
    files = (
        *(good + RIGHTS, good, good.replace("baud = 19200", "baud = 7")),
        *(
            paced,
            f"{end}{ABSENT}\n[[operator]]{operators}",
            good.replace('family = "sst"', 'family = "none"'),
        ),
    )
    await w.start("pump")
    await w.calm()
    await w.starters.order("mark")
    lives, boot = len(w.gateway.lives), w.recorder.latest["gateway/status"]["boot"]
    slowest_s = 0.0
    warm = max(count // 4, len(files) - 1)  # each kind of change was made once: the pool of threads is filled
    for number in range(count):
        await asyncio.sleep(w.dice.uniform(0.1, 1.5))
        file = files[number % len(files)]
        slowest_s = max(slowest_s, await _reloaded(w, file, EVENTS[number % 3 == 2]))
        if number == warm:
            w.sample()
    await _reloaded(w, good, EVENTS[0])
    w.sample()
    await w.check_line_timing("a reload made a starter wait")
    w.measurements["slowest s"] = round(slowest_s, 2)
    w.check(len(w.gateway.lives) == lives, "a reload ended the process")
    w.check(w.recorder.latest["gateway/status"]["boot"] == boot, "a reload cut the connection to the broker")
    await w.right_still()
    await w.stop("pump")


async def reopened(w: World, count: int) -> None:
    """Change the line itself, so that its port is closed and opened anew; a motor runs."""
    good = w.gateway.config.read_text("utf-8")
    other = good.replace('framing = "8N2"', 'framing = "8N2"\nadapter_allowance_s = 0.021')
    await w.start("pump")
    await w.calm()
    await w.starters.order("mark")
    for number in range(count):
        await asyncio.sleep(w.dice.uniform(2.0, 4.0))
        await _reloaded(w, (other, good)[number % 2], EVENTS[0])
    await asyncio.sleep(2.0)
    await w.check_line_timing("opening a line anew made a starter wait")
    await _reloaded(w, good, EVENTS[0])
    await w.right(since_s=0.0)
    await w.stop("pump")


async def _reloaded(w: World, file: str, event: str) -> float:
    """Have a file read and wait for what comes of it; return how long that took."""
    w.gateway.config.write_text(file, "utf-8")
    begun_s = time.monotonic()
    w.gateway.signal(signal.SIGHUP)
    return await w.recorder.event(event, since_s=begun_s, within_s=OVER_WITHIN_S) - begun_s


SCENARIOS = (
    Scenario("reload", Place.CRASH, reload, 100, 6, "times", quick=6),
    Scenario("reload of the line", Place.CRASH, reopened, 40, 2, "times"),
)
