"""A starter's communication watchdog, read from it, becomes the line's deadline for it."""

from __future__ import annotations

import asyncio

import pytest

from gateway.families.diagnosis.readiness import readiness_codes
from gateway.starters.services.readiness import ReadinessService
from tests.starters.rig import Rig, virtually


async def deadline_of(rig: Rig, *, after_s: int) -> float | None:
    """Return what the line keeps once the starter's settings have been read."""
    profile = rig.telemetry.profile
    for code in readiness_codes(profile):
        rig.unit.holding.setdefault(profile.parameters[code].address, 0)
    rig.unit.holding[314], rig.unit.holding[313] = after_s, 2
    watch = ReadinessService(rig.telemetry)

    watch.begin()
    await asyncio.sleep(5.0)

    await watch.close()
    return rig.line.deadlines_s[rig.setup.address]


@pytest.mark.parametrize(("after_s", "deadline_s"), [(7, 7.0), (0, None)])
@virtually
async def test_the_watchdog_that_is_set_in_a_starter_is_a_deadline(
    after_s: int, deadline_s: float | None
) -> None:
    rig = await Rig().online()

    assert await deadline_of(rig, after_s=after_s) == deadline_s
