"""A starter's watchdog is read as soon as it answers: its deadline holds from the first lap on."""

from __future__ import annotations

import asyncio
from itertools import pairwise

import pytest

from gateway.line.scheduler.requests import Priority
from gateway.modbus.reads import ReadHoldingRegisters
from tests.starters.large_line import LargeLine, large_line
from tests.starters.rig import Rig, virtually

P314 = 314
WATCHDOG = ReadHoldingRegisters(313, 2)
LIMIT_S = 3
SHORT = 18  # starters with that watchdog, on a line of 60 at 9600: as many as it can keep


def longest_left_s(line: LargeLine, count: int) -> dict[int, float]:
    """Return by starter the longest time between two requests that reached it."""
    times = {each: line.asked_s[each] for each in range(1, count + 1)}
    return {each: max(b - a for a, b in pairwise(found)) for each, found in times.items()}


@pytest.mark.parametrize("first", [1, 43])
@virtually
async def test_unknown_watchdogs_are_met_from_the_first_lap_on(first: int) -> None:
    async with large_line(60, baud=9600) as line:
        short = range(first, first + SHORT)
        for each in short:
            line.unit(each).settings[P314] = LIMIT_S
        await asyncio.sleep(60.0)

        left_s = longest_left_s(line, 60)

    assert max(left_s[each] for each in short) <= LIMIT_S, left_s


@virtually
async def test_it_goes_before_the_polls_while_it_is_not_known_and_behind_the_first_lap_when_it_is() -> None:
    rig = Rig()
    rig.unit.holding |= {313: 1, P314: 30}
    await rig.online()
    rig.line.sent.clear()

    for _ in range(2):
        rig.lose()
        rig.poll()
        await asyncio.sleep(1.0)
    known = [sent.lane for sent in rig.line.sent if sent.request == WATCHDOG]

    unknown = Rig()
    unknown.unit.holding |= {313: 1, P314: 30}
    unknown.telemetry.start()
    unknown.poll()
    await asyncio.sleep(1.0)
    first = unknown.line.sent[0]

    assert known == [Priority.IDENTITY, Priority.IDENTITY]
    assert (first.request, first.lane) == (WATCHDOG, Priority.WATCHDOG)
    assert unknown.line.deadlines_s[7] == 30.0
