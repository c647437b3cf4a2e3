"""When starters are asked while others come, go and change; in virtual time."""

from __future__ import annotations

import asyncio
import functools
from itertools import pairwise
from typing import Any

import pytest

from tests.plant_rig import WATCHDOG_S, YARD, running, starter
from tests.starters.rig import virtually
from tests.virtual_time import run_virtually

SETTLED_S, RUN_S = 30.0, 60.0
REGULAR_S = 1.3  # the longest that a settled starter of this site waits for a request, at a period of 1 s
SHARED_S = 0.02  # what lines share is when their events are handed over, after which a period may change
SLOT_S = 0.25  # more than any one slot of another starter on its line
COMES_WITHIN_S = 5.0  # from a reload until the state of a starter that comes is known
WATCHED = f"watchdog_s = {WATCHDOG_S}\n"


async def times_of(*changes: tuple[str, str]) -> dict[str, list[float]]:
    """Return when each starter was asked; with changes, these are made and taken back three times."""
    async with running(SETTLED_S) as here:
        for _ in range(3 if changes else 0):
            await here.reload(*changes)
            await asyncio.sleep(3.0)
            await here.reload()
            await asyncio.sleep(3.0)
        await asyncio.sleep(RUN_S - asyncio.get_running_loop().time())
        assert here.trips() == []
        assert here.writes() == 0
        return here.requests_s


@functools.cache
def undisturbed_times() -> dict[str, list[float]]:
    return run_virtually(times_of())


def longest_gap_s(times_s: list[float]) -> float:
    return max(after - before for before, after in pairwise(times_s) if before >= SETTLED_S - 2.0)


BELT = starter("belt", 2, "sst")
FAN = starter("fan", 2, "ssw06")


@pytest.mark.parametrize(
    "changes",
    [
        ((BELT, ""),),
        ((YARD, YARD.replace('port = "/dev/yard"', 'port = "/dev/yard"\nadapter_allowance_s = 0.05')),),
        ((YARD, ""),),
    ],
    ids=["starter gone", "line reopened", "line gone"],
)
def test_a_line_that_stays_is_polled_at_the_same_instants_as_without_a_reload(
    changes: tuple[tuple[str, str], ...],
) -> None:
    undisturbed = undisturbed_times()

    reloaded = run_virtually(times_of(*changes))

    for place in ("hall 1", "hall 2"):
        assert reloaded[place] == pytest.approx(undisturbed[place], abs=SHARED_S)
    assert reloaded["yard 2"] != undisturbed["yard 2"]
    assert longest_gap_s(undisturbed["hall 1"]) < REGULAR_S


@virtually
async def test_a_starter_that_comes_to_an_overfull_line_is_known_soon_and_stays_known() -> None:
    pump = starter("pump", 1, "ssw07").replace(WATCHED, "")
    busy = pump.replace("every_s = 1.0", "every_s = 0.002")
    blower = starter("blower", 2, "ssw06").replace(WATCHED, "").replace("every_s = 1.0", "every_s = 2.0")
    async with running(SETTLED_S) as here:
        spoken: list[tuple[float, str]] = []
        await here.reload((starter("pump", 1, "ssw07"), busy), (FAN, blower))
        for _ in range(700):
            state = here.plant.starters["blower"].state
            now_s = asyncio.get_running_loop().time()
            if not spoken or spoken[-1][1] != state:
                spoken.append((now_s, state))
            if len(spoken) == 2 and now_s > SETTLED_S + 30.0 and state == "ready":
                fan: Any = here.unit("hall", 2)
                fan._set_remote(is_remote=False)
                fan.keypad_start()
                fan._set_remote(is_remote=True)
            await asyncio.sleep(0.1)

        assert here.plant.lines["hall"].stretch > 5.0
        assert "running" in {state for _, state in spoken}
        assert [state for _, state in spoken].count("unknown") == 1
        assert spoken[1][0] - spoken[0][0] < COMES_WITHIN_S
