"""A stop that comes while the gateway begins: it goes out at once and is confirmed by the first readings."""

from __future__ import annotations

import asyncio

import pytest

from gateway.records import Phase
from tests.starters.rig import virtually
from tests.starters.world import PAUSE_S, STOP_PDU, GatewayWorld

FRAME_WITHIN_S = 0.1  # the port is opened, and one transaction may be under way
CONFIRMED_WITHIN_S = 0.5  # two readings 0.1 s apart, of a motor that decelerates at once


@pytest.mark.parametrize("after_s", [0.001, 0.01, 0.02, 0.03, 0.05, 0.1, 0.3, 1.0, 2.0])
@pytest.mark.parametrize("starter", ["a", "b"])
@virtually
async def test_a_stop_just_after_the_start_is_confirmed_as_soon_as_at_any_other_time(
    starter: str, after_s: float
) -> None:
    world = GatewayWorld()
    await asyncio.sleep(2.0 + PAUSE_S)
    world.publish(starter, "alice", "start", id="1", token=world.token()[1])
    await asyncio.sleep(2.0)
    assert world.units[starter].motor.is_turned_on

    await quiet(world)
    await world.crash()
    await asyncio.sleep(after_s)
    asked_s = world.clock.now_s()
    world.publish(starter, "alice", "stop", id="2")
    await asyncio.sleep(15.0)

    frames_s = [at_s for at_s in world.frames(starter, STOP_PDU) if at_s >= asked_s]
    phases = [(at_s, each.phase) for at_s, each in world.results([starter]) if each.id == "2"]
    assert frames_s[0] - asked_s <= FRAME_WITHIN_S
    assert len(frames_s) == 1  # acknowledged: it need not be repeated
    assert [phase for _, phase in phases] == [Phase.ACCEPTED, Phase.WRITTEN, Phase.CONFIRMED]
    assert phases[-1][0] - frames_s[0] <= CONFIRMED_WITHIN_S
    await world.close()


async def quiet(world: GatewayWorld) -> None:
    """Wait until a reply is over: what is left of a request that is cut would run into the first stop."""
    before = len(world.bus.transcript)
    while (  # noqa: ASYNC110 - the line has no event for that
        len(world.bus.transcript) == before or world.bus.transcript[-1].sender == 0
    ):
        await asyncio.sleep(0.0005)
