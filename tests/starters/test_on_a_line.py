"""All but MQTT on a simulated line with a starter of each family, in virtual time."""

from __future__ import annotations

import asyncio

import pytest

from gateway.families.profile.load import FAMILIES
from gateway.records import (
    Phase,
    ResultRecord,
    StateRecord,
)
from gateway.sim.bus.faults import Noisy
from tests.starters.four_starters import LostWrites, bring_to_ready, site
from tests.starters.rig import virtually

TRIPS = {"ssw06": 5, "ssw07": 5, "ssw900": 5, "sst": 12}


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_start_whose_answer_is_lost_is_sent_once_and_confirmed(family: str) -> None:
    async with site() as here:
        await bring_to_ready(here, family)
        unit = here.unit(family)
        here.bus.impair(unit.address, LostWrites())

        here.submit(family, "start", "1")
        await asyncio.sleep(30.0)

        assert len(unit.start_frames) == 1
        assert here.sink.final("1").phase is Phase.CONFIRMED


@virtually
async def test_a_noisy_line_never_makes_a_start_go_out_twice_or_a_false_state() -> None:
    async with site() as here:
        here.bus.noise = Noisy(0.002)

        for round_ in range(4):  # more would trip the overload
            here.submit("ssw07", "start", f"start {round_}")
            await asyncio.sleep(8.0)
            here.submit("ssw07", "stop", f"stop {round_}")
            await asyncio.sleep(22.0)

        unit = here.unit("ssw07")
        accepted = [
            r.id for r in here.sink.of(ResultRecord) if r.verb == "start" and r.phase is Phase.WRITTEN
        ]
        assert len(unit.start_frames) <= len(accepted)
        finals = [r.id for r in here.sink.of(ResultRecord) if r.phase.is_final]
        assert len(finals) == len(set(finals)) == 8
        assert {r.state for r in here.sink.of(StateRecord) if r.starter == "ssw07"} <= {
            "ready",
            "starting",
            "running",
            "stopping",
            "unknown",
        }
