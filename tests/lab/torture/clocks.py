"""The wall clock steps: to and fro, by seconds or years, and back to 1970; in virtual time."""

from __future__ import annotations

import asyncio
import random
from dataclasses import dataclass

from gateway.records import Phase
from tests.lab.torture.noise import REST_S, RUN_S, STARTED
from tests.lab.torture.scenario import Row
from tests.lab.torture.virtual_line import VirtualLine, virtual_line, virtual_row
from tests.virtual_time import EPOCH_S

STEPS_S = (-3600.0, -2.0, -0.01, 0.01, 2.0, 3600.0, 10 * 366 * 86_400.0)
VALUES_WITHIN_S = RUN_S  # while a motor starts there is always news
RATE_TOLERANCE = 0.02


@dataclass(frozen=True)
class ClockScenario:
    """Every three minutes the clock steps, while a motor starts; the box boots in 1970."""

    name: str = "clock steps"
    whole: int = 200
    short: int = 5

    def row(self, count: int, seed: int) -> Row:
        """Let the clock step so many times and judge."""
        return virtual_row(self.name, f"{count} times", lambda row: self._run(row, count, seed))

    async def _run(self, row: Row, count: int, seed: int) -> None:
        dice = random.Random(seed)
        confirmed = 0
        async with virtual_line(seed) as line:
            line.clock.epoch_s = 0.0
            before = await self._transactions(line)
            line.judge.never_on -= {STARTED}
            for _ in range(count):
                id_ = line.command(STARTED, "start")
                await asyncio.sleep(dice.uniform(0.0, 2.0))
                _step(line, dice)
                await asyncio.sleep(RUN_S)
                finals = line.judge.finals.get(id_, [])
                confirmed += bool(finals) and finals[0].phase is Phase.CONFIRMED
                apart_s = line.clock.utc_s() - line.judge.value_time_s
                if not 0.0 <= apart_s <= VALUES_WITHIN_S:
                    row.failures.append(f"values are {apart_s:.3f} s apart from the clock")
                line.command(STARTED, "stop")
                await asyncio.sleep(REST_S)
            after = await self._transactions(line)
            for is_right, what in (
                (confirmed == count, f"{confirmed} of {count} starts were confirmed"),
                (not line.judge.false, f"false: {line.judge.false.most_common(3)}"),
                (not line.trips(), f"watchdogs tripped: {line.trips()[:3]}"),
                (not line.bus.violations, f"line violations: {line.bus.violations[:3]}"),
                (abs(after / before - 1) <= RATE_TOLERANCE, f"the line's rate changed: {before} -> {after}"),
            ):
                if not is_right:
                    row.failures.append(what)
            row.measurements = {"transactions": line.transactions, "confirmed": confirmed}

    async def _transactions(self, line: VirtualLine) -> int:
        """Return how many there are in a minute."""
        before = line.transactions
        await asyncio.sleep(60.0)
        return line.transactions - before


def _step(line: VirtualLine, dice: random.Random) -> None:
    now_s = line.clock.utc_s()
    match dice.randrange(4):
        case 0:
            line.clock.epoch_s -= now_s  # 1970
        case 1:
            line.clock.epoch_s += EPOCH_S - now_s  # set rightly
        case _:
            line.clock.epoch_s += max(dice.choice(STEPS_S), -now_s)


SCENARIOS = (ClockScenario(),)
