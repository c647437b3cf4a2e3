"""Starters with watchdogs that receive every request, some of whose replies are lost: none of them acts."""

from __future__ import annotations

import asyncio
import random

import pytest

from gateway.sim.bus.faults import NoReply
from tests.starters.large_line import large_line, longest_gap_s
from tests.starters.rig import virtually

COUNT, LOSSY = 20, range(1, 8)
WATCHDOG_S = 2.6  # the shortest that `check` accepts for so many


@pytest.mark.parametrize("seed", [1, 2, 3])  # a sample: with one seed in four a unit rests for too long
@virtually
async def test_no_watchdog_shorter_than_the_period_acts_where_a_twentieth_of_the_replies_is_lost(
    seed: int,
) -> None:
    async with large_line(COUNT, every_s=5.0, watchdog_s=WATCHDOG_S) as here:
        await asyncio.sleep(30.0)
        here.bus._dice = random.Random(seed)
        for address in LOSSY:
            here.bus.impair(address, NoReply(), chance=0.05)
        since_s = here.clock.now_s()
        await asyncio.sleep(150.0)

        until_s = here.clock.now_s()
        for address in range(1, COUNT + 1):
            asked_s = [at_s for at_s in here.asked_s[address] if at_s >= since_s]
            assert longest_gap_s(asked_s, until_s) < WATCHDOG_S
