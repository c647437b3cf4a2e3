"""What the history costs a line: the rows that starters are asked for because of it; virtual time."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from itertools import pairwise

from tests.plant_rig import running, starter

LONG_S = 3600.0
FAMILIES = {**dict.fromkeys(range(3, 7), "ssw900"), **dict.fromkeys(range(7, 9), "ssw07")}
BASE = starter("fan", 2, "ssw06")
STARTED = (3, 7)  # addresses of motors that start four times


@dataclass(frozen=True)
class LineCost:
    """An hour of a line with eight starters and periods of 1 s."""

    requests: int
    polls_pct: float  # requests, in percent of two each second for each starter
    longest_gap_s: float  # without a request, of any starter
    trips: int  # of watchdogs


async def cost(*, has_history: bool, long_s: float = LONG_S) -> LineCost:
    """Measure an hour, with starts."""
    table = "".join(starter(f"motor-{each}", each, family) for each, family in FAMILIES.items())
    more = [("hall", each, family) for each, family in FAMILIES.items()]
    async with running(60.0, (BASE, BASE + table), more=more, has_past=has_history) as here:
        loop = asyncio.get_running_loop()
        since_s = loop.time()
        for _ in range(4):
            for address in STARTED:
                unit = here.unit("hall", address)
                unit.advance(loop.time())
                unit.motor.start()
            await asyncio.sleep(long_s / 8)
            for address in STARTED:
                here.unit("hall", address).motor.stop()
            await asyncio.sleep(long_s / 8)
        hall = {key: times for key, times in here.requests_s.items() if key.startswith("hall ")}
        lists = [[at_s for at_s in times if at_s >= since_s] for times in hall.values()]
        requests = sum(map(len, lists))
        gaps = [later - earlier for times in lists for earlier, later in pairwise(times)]
        wanted = 2 * long_s * len(hall)
        return LineCost(requests, 100 * requests / wanted, max(gaps), len(here.trips()))
