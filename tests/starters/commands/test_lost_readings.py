"""Before a start writes anything, two lost replies in a row to the same question do not end it."""

from __future__ import annotations

import asyncio
import random
from dataclasses import dataclass

import pytest

from gateway.families.profile.load import FAMILIES
from gateway.records import Phase
from gateway.sim.bus.faults import Reply
from gateway.sim.factory import make_unit
from tests.starters.one_starter import one_starter
from tests.starters.rig import virtually

SELDOM_S = 60.0  # so that no poll falls between


@dataclass
class LosesSome:
    """An impairment: the first replies of a starter are passed on, then some are lost."""

    passes: int
    loses: int

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        """Return what arrives."""
        if self.passes:
            self.passes -= 1
            return (reply,)
        self.loses -= 1
        return () if self.loses >= 0 else (reply,)


@pytest.mark.parametrize("passes", range(5))
@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_start_outlasts_two_lost_replies_in_a_row(family: str, passes: int) -> None:
    async with one_starter(make_unit(family, 1), every_s=SELDOM_S) as here:
        await asyncio.sleep(2.5 * SELDOM_S)
        here.bus.impair(1, LosesSome(passes, 2))

        here.submit("start", "s")
        await asyncio.sleep(20.0)

        assert here.sink.final("s").phase is Phase.CONFIRMED
