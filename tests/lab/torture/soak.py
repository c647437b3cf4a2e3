"""Days of a line with faults that come and go, in virtual time: does anything grow?"""

from __future__ import annotations

import asyncio
import gc
import random
from dataclasses import dataclass
from pathlib import Path

from gateway.sim.bus.faults import Babbling, CutShort, Doubled, Impairment, Late, Noisy, NoReply
from tests.lab.torture.noise import STARTED
from tests.lab.torture.scenario import Row
from tests.lab.torture.virtual_line import VirtualLine, virtual_line, virtual_row

EVERY_S = 10.0  # the starters' period; a day then takes some minutes
HOUR_S = 3600.0
GROWTH_KB_PER_H = 1024.0
WARM_UP = 0.3  # of the hours
# The first reply that comes twice may be taken for the next request's answer (RTU replies carry neither
# number nor address). From then on its sender is given time.
ONE_READING = 16  # values: the bits of a word
FAULTS: tuple[Impairment, ...] = (
    *(NoReply(), Late(2.0), Noisy(0.01), CutShort(2), Doubled(0.02), Babbling(every_s=2.0)),
)


@dataclass(frozen=True)
class SoakScenario:
    """Every hour another starter has another fault for a while, and one motor is started and stopped."""

    name: str = "soak, virtual"
    whole: int = 7 * 24
    short: int = 2

    def row(self, count: int, seed: int) -> Row:
        """Let so many hours pass and judge."""
        return virtual_row(self.name, f"{count} h", lambda row: self._run(row, count, seed))

    async def _run(self, row: Row, count: int, seed: int) -> None:
        dice = random.Random(seed)
        used_kb: list[int] = []
        async with virtual_line(seed, every_s=EVERY_S) as line:
            tasks = len(asyncio.all_tasks())
            doubled = 0
            for _ in range(count):
                before = line.judge.false.copy()
                if isinstance(await self._hour(line, dice), Doubled):
                    wrong = (line.judge.false - before).total()
                    doubled += wrong
                    line.judge.false = before
                    if wrong > ONE_READING:
                        row.failures.append(f"{wrong} wrong values after doubled replies")
                line.judge.finals.clear()  # the judge's own books are not what is weighed
                gc.collect()
                used_kb.append(_used_kb())
            row.measurements = {"transactions": line.transactions, "tasks": len(asyncio.all_tasks())}
            row.measurements["wrong after a doubled reply"] = doubled
            if len(asyncio.all_tasks()) > tasks + 2:
                row.failures.append(f"tasks {tasks} -> {len(asyncio.all_tasks())}")
            if line.judge.false:
                row.failures.append(f"false: {line.judge.false.most_common(3)}")
        settled = used_kb[int(len(used_kb) * WARM_UP) :]
        growth = (settled[-1] - settled[0]) / max(len(settled) - 1, 1)
        row.measurements["growth KB/h"] = round(growth, 1)
        if count >= 24 and growth > GROWTH_KB_PER_H:
            row.failures.append(f"memory grows by {growth:.0f} KB in an hour")

    async def _hour(self, line: VirtualLine, dice: random.Random) -> Impairment:
        address, fault = dice.choice(line.bus.units).address, dice.choice(FAULTS)
        line.bus.impair(address, fault, chance=dice.choice((0.1, 1.0)))
        line.judge.never_on -= {STARTED}
        line.command(STARTED, "start")
        await asyncio.sleep(dice.uniform(10.0, HOUR_S / 4))
        line.bus.heal(address)
        line.command(STARTED, "stop")
        if dice.random() < 0.3:
            line.bus.unplug()
            await asyncio.sleep(dice.uniform(1.0, 60.0))
            line.bus.plug_in()
        await asyncio.sleep(HOUR_S * 0.7)
        return fault


def _used_kb() -> int:
    pages = int(Path("/proc/self/statm").read_text("utf-8").split()[1])
    return pages * 4


SCENARIOS = (SoakScenario(),)
