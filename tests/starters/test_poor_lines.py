"""A line that loses or corrupts replies: the starters stay online, and none is accused of anything."""

from __future__ import annotations

import asyncio
import random

import pytest

from gateway.families.profile.load import FAMILIES
from gateway.line.rtu.bus_faults import ADDRESS_CONFLICT, LINE_NOISE
from gateway.records import AvailabilityRecord, EventRecord, StateRecord
from gateway.sim.bus.faults import Noisy, NoReply
from tests.starters.four_starters import site
from tests.starters.rig import virtually


@pytest.mark.parametrize("seed", range(3))
@virtually
async def test_a_twentieth_of_the_replies_lost_for_200_s_takes_no_starter_offline(seed: int) -> None:
    async with site() as here:
        here.bus._dice = random.Random(seed)
        for family in FAMILIES:
            here.bus.impair(here.unit(family).address, NoReply(), chance=0.05)
        await asyncio.sleep(200.0)

        assert "offline" not in {each.state for each in here.sink.of(AvailabilityRecord)}
        states = [each.state for each in here.sink.of(StateRecord)]
        assert set(states) <= {"ready", "not_ready", "unknown"}
        assert (
            states.count("unknown") <= 2
        )  # a status whose second reading is lost as well waits for its next time
        assert "went_silent" not in {each.code for each in here.sink.of(EventRecord)}


@virtually
async def test_a_fifth_of_the_replies_noisy_accuses_no_address_of_conflict() -> None:
    async with site() as here:
        for family in FAMILIES:
            here.bus.impair(here.unit(family).address, Noisy(0.02), chance=0.2)
        await asyncio.sleep(120.0)

    assert LINE_NOISE in here.faults
    assert ADDRESS_CONFLICT not in here.faults
