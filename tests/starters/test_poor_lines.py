"""A line that loses or corrupts replies: the starters stay online, and none is accused of anything."""

from __future__ import annotations

import asyncio
import random
from collections import Counter, deque
from collections.abc import Iterable

import pytest

from gateway.families.profile.load import FAMILIES
from gateway.line.rtu.bus_faults import ADDRESS_CONFLICT, LINE_NOISE
from gateway.line.scheduler.units import OFFLINE_AFTER
from gateway.records import AvailabilityRecord, EventRecord, StateRecord
from gateway.sim.bus.bus import Frame
from gateway.sim.bus.faults import Noisy, NoReply
from tests.starters.four_starters import site
from tests.starters.rig import virtually


@pytest.mark.parametrize("seed", [1])
@virtually
async def test_a_twentieth_of_the_replies_lost_takes_no_starter_offline_but_by_four_in_a_row(
    seed: int,
) -> None:
    """Of 1 900 polls in 200 s, 1 900 * 0.95 * 0.05 ** 4 = 0.011 begin such a row: one run in 90."""
    async with site() as here:
        here.bus.transcript = deque()  # all of it: such a row may lie anywhere
        here.bus._dice = random.Random(seed)
        for family in FAMILIES:
            here.bus.impair(here.unit(family).address, NoReply(), chance=0.05)
        await asyncio.sleep(200.0)

        rows = lost_in_a_row(here.bus.transcript)
        offline = [each.state for each in here.sink.of(AvailabilityRecord)].count("offline")
        assert offline == [each.code for each in here.sink.of(EventRecord)].count("went_silent")
        assert offline <= sum(length >= OFFLINE_AFTER for length in rows)
        states = [each.state for each in here.sink.of(StateRecord)]
        assert set(states) <= {"ready", "not_ready", "unknown"}
        # A status whose second reading is lost as well waits for its next time.
        assert states.count("unknown") <= 2 + 2 * offline


def lost_in_a_row(transcript: Iterable[Frame]) -> list[int]:
    """Return how many replies of a starter were lost in a row, each time that any was."""
    rows: list[int] = []
    lost: Counter[int] = Counter()
    for frame in transcript:
        unit = frame.data[0]
        if frame.sender == 0:
            lost[unit] += 1  # until it answers
        else:
            rows.append(lost.pop(unit, 1) - 1)
    return [*(length for length in rows if length), *lost.values()]


@virtually
async def test_a_fifth_of_the_replies_noisy_accuses_no_address_of_conflict() -> None:
    async with site() as here:
        for family in FAMILIES:
            here.bus.impair(here.unit(family).address, Noisy(0.02), chance=0.2)
        await asyncio.sleep(120.0)

    assert LINE_NOISE in here.faults
    assert ADDRESS_CONFLICT not in here.faults
