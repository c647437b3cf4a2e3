"""Two gateways, the site's broker and a central one, a link that is cut, a gateway that is killed."""

from __future__ import annotations

import signal
from collections import Counter
from pathlib import Path

import pytest

from tests.fleet.fleet import FleetPlan, FleetResult, fleet
from tests.fleet.site import IN_FLIGHT
from tests.mosquitto import missing_programs

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(bool(missing_programs()), reason="Mosquitto is not installed"),
]
PLAN = FleetPlan(gateways=2, starters=4, seconds=6.0)
REPLACED = 8  # of each starter and run: what a newer message replaced before it could be sent


async def run(folder: Path) -> FleetResult:
    async with fleet(PLAN, folder) as it:
        await it.start_up()
        await it.start_motors()
        await it.cut_and_restart()
        await it.end()
        return it.result


async def test_a_fleets_messages_reach_the_central_broker_whole_over_a_cut_a_kill_and_a_restart(
    tmp_path: Path,
) -> None:
    result = await run(tmp_path)

    found = result.verdict
    assert found is not None
    assert found.lost == []
    assert found.foreign == []
    assert found.old_at_end == []
    assert result.differing == []  # also topics whose messages have no number
    assert found.messages > 1000
    assert found.repeated > 0  # a bridge that comes back repeats what is retained
    assert len(found.topics_backwards) <= IN_FLIGHT  # of these the newest came before the backlog
    assert all(len(missing) <= REPLACED * PLAN.starters for missing in found.holes.values())
    assert result.starts == Counter({"confirmed: ok": PLAN.gateways * PLAN.starters})
    assert result.exits == [-signal.SIGKILL, 0, 0, 0]
    assert result.cut["messages"] > 100
    starters = {tuple(topic.split("/")[3:6:2]) for topic in result.retained if "/starter/" in topic}
    assert len(starters) == PLAN.gateways * PLAN.starters
