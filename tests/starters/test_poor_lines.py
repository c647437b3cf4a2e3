"""A line that loses or corrupts replies: the starters stay online, and none is accused of anything."""

from __future__ import annotations

import asyncio
import random

import pytest

from gateway.families.profile.load import FAMILIES
from gateway.line.rtu.bus_faults import ADDRESS_CONFLICT, LINE_NOISE
from gateway.records import AvailabilityRecord, EventRecord, StateRecord
from gateway.sim.bus.faults import Noisy, NoReply
from tests.starters.four_starters import Router, site
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
        assert {each.state for each in here.sink.of(StateRecord)} <= {"ready", "not_ready"}
        assert "went_silent" not in {each.code for each in here.sink.of(EventRecord)}


@virtually
async def test_a_fifth_of_the_replies_noisy_accuses_no_address_of_conflict(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    troubles: list[str] = []

    def note(self: object, line: str, code: str, unit: int, text: str, frames: tuple[str, ...]) -> None:
        troubles.append(code)

    monkeypatch.setattr(Router, "on_trouble", note, raising=False)
    async with site() as here:
        for family in FAMILIES:
            here.bus.impair(here.unit(family).address, Noisy(0.02), chance=0.2)
        await asyncio.sleep(120.0)

    assert LINE_NOISE in troubles
    assert ADDRESS_CONFLICT not in troubles
