"""A starter whose replies all come late, and a dead one whose replies a serial server still delivers."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from gateway.families.profile.load import FAMILIES
from gateway.sim.bus.port import SimulatedPort
from gateway.sim.factory import make_unit
from tests.starters.one_starter import OneStarter, one_starter
from tests.starters.rig import virtually
from tests.virtual_time import EPOCH_S

Delay = Callable[[float], float]  # of what arrives now; in seconds


@pytest.fixture
def delay(monkeypatch: pytest.MonkeyPatch) -> list[Delay]:
    """Delay all that arrives by the last of these, if there is one."""
    delays: list[Delay] = []
    take = SimulatedPort._take

    def take_late(port: SimulatedPort, chunk: bytes, arrival_s: float) -> None:
        if not delays:
            take(port, chunk, arrival_s)
            return
        loop = asyncio.get_running_loop()
        at_s = loop.time() + delays[-1](loop.time())
        loop.call_at(at_s, take, port, chunk, at_s)

    monkeypatch.setattr(SimulatedPort, "_take", take_late)
    return delays


def silences_s(here: OneStarter, since_s: float) -> list[float]:
    return [event.time_s - EPOCH_S - since_s for event in here.events("went_silent")]


@pytest.mark.parametrize("late_s", [2.0])
@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_starter_that_is_only_late_is_offline_after_30_s(
    family: str, late_s: float, delay: list[Delay]
) -> None:
    async with one_starter(make_unit(family, 1, seed=0)) as here:
        await asyncio.sleep(10.0)
        delay.append(lambda _: late_s)
        since_s = asyncio.get_running_loop().time()
        await asyncio.sleep(60.0)

        (silent_s,) = silences_s(here, since_s)
        assert 28.0 < silent_s < 35.0


@pytest.mark.parametrize("every_s", [3.0])
@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_replies_of_a_dead_starter_are_not_taken_for_its_return(
    family: str, every_s: float, delay: list[Delay]
) -> None:
    """A serial server hands on the last ones that it has, one every few seconds."""
    async with one_starter(make_unit(family, 1, seed=0), every_s=0.25) as here:
        await asyncio.sleep(10.0)
        next_s = asyncio.get_running_loop().time() + every_s

        def drip(now_s: float) -> float:
            nonlocal next_s
            next_s += every_s
            return max(next_s - now_s, 0.01)

        delay.append(drip)
        await asyncio.sleep(3.0)
        here.bus.remove(here.unit)
        here.submit("start", "s1")
        await asyncio.sleep(2.0)
        here.submit("stop", "p1")
        await asyncio.sleep(60.0)

        assert here.events("answers_again") == []
        assert len(here.events("went_silent")) == 1
