"""A starter is seen as it is though some of its replies are lost for good."""

from __future__ import annotations

import asyncio
from itertools import pairwise

import pytest

from gateway.families.load import load_profile
from gateway.families.schema import Variant
from gateway.line.outcome import Answered, Outcome
from gateway.line.scheduler import Scheduler
from gateway.modbus.timing import Framing, LineTiming
from gateway.sim.factory import make_unit
from gateway.sim.impair import Silent
from gateway.sim.line import SimulatedLine
from gateway.starters.polling import polls_of
from gateway.starters.setup import StarterSetup
from tests.virtual_time import run_virtually

TIMING = LineTiming(19200, Framing.parse("8E1"))
EVERY_S = 0.5
FOR_S = 120.0
LONGEST_GAP_S = 3.0


class Router:
    """Notes when which poll was answered."""

    def __init__(self) -> None:
        self.answered_s: dict[str, list[float]] = {}

    def on_poll(self, line: str, key: str, unit: int, outcome: Outcome) -> None:
        if isinstance(outcome, Answered):
            self.answered_s.setdefault(key, []).append(asyncio.get_running_loop().time())

    def on_unit(self, line: str, unit: int, is_answering: bool, reason: str, frames: tuple[str, ...]) -> None:
        assert is_answering, reason

    def on_trouble(self, line: str, code: str, unit: int, text: str, frames: tuple[str, ...]) -> None: ...

    def on_port(self, line: str, is_open: bool, reason: str) -> None: ...


@pytest.mark.parametrize("starters", [1, 3])
@pytest.mark.parametrize("family", ["ssw06", "ssw07"])  # with the fewest forms
def test_with_one_reply_in_a_hundred_lost_the_status_is_hardly_ever_a_second_late(
    family: str, starters: int
) -> None:
    router = Router()
    profile = load_profile(family)
    setups = [
        StarterSetup(f"{family}-{at}", "x", at, profile, Variant(), every_s=EVERY_S, timing=TIMING)
        for at in range(1, starters + 1)
    ]
    polls = [poll for setup in setups for poll in polls_of(setup)]

    async def scenario() -> None:
        bus = SimulatedLine(TIMING, [make_unit(family, setup.address) for setup in setups], seed=1)
        line = Scheduler(name="x", opener=bus.opener(), timing=TIMING, polls=polls, listener=router)
        serving = asyncio.create_task(line.run())
        await asyncio.sleep(5.0)
        for setup in setups:
            bus.impair(setup.address, Silent(), chance=0.01)
        await asyncio.sleep(FOR_S)
        serving.cancel()
        await asyncio.wait([serving])

    run_virtually(scenario())

    for poll in polls:
        if poll.group == "status":
            gaps_s = [later - earlier for earlier, later in pairwise(router.answered_s[poll.key])]
            assert max(gaps_s) < LONGEST_GAP_S
            assert sum(gap_s > EVERY_S + 1.0 for gap_s in gaps_s) <= 0.01 * len(gaps_s)
            assert len(gaps_s) > 0.8 * FOR_S / EVERY_S
