"""What a bad line and bad units do to values and commands, in virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from gateway.families.profile.load import FAMILIES
from gateway.records import Phase
from gateway.sim.bus.faults import Babbling, Late, Noisy
from gateway.sim.factory import make_unit
from gateway.sim.weg.command_sources import P_TIMEOUT
from tests.lab.torture.scenario import Row
from tests.lab.torture.truth import Truth
from tests.lab.torture.virtual_line import VirtualLine, virtual_line, virtual_row

RUN_S, REST_S = 15.0, 165.0  # more starts would trip the overload
UNDETECTED = (
    20_000  # one of so many corrupted frames passes a CRC-16 (1 in 51,000 of those with 1-6 wrong bits)
)
STARTED = "ssw07"


@dataclass(frozen=True)
class NoiseScenario:
    """A fault of the line; `corrupt` brings it about."""

    name: str
    corrupt: Callable[[VirtualLine], None]
    corrupted_share: float = 0.0  # of the replies
    names: str = ""  # the trouble that must be reported
    is_legible: bool = True  # commands can be carried out
    whole: int = 100_000
    short: int = 1_500

    def row(self, count: int, seed: int) -> Row:
        """Run so many transactions and judge."""
        return virtual_row(self.name, f"{count} frames", lambda row: self._run(row, count, seed))

    async def _run(self, row: Row, count: int, seed: int) -> None:
        async with virtual_line(seed) as line:
            self.corrupt(line)
            starts: list[str] = []
            while line.transactions < count or not starts:
                line.judge.never_on -= {STARTED}
                begun = _started(line)
                starts.append(line.command(STARTED, "start"))
                await asyncio.sleep(RUN_S)
                finals = line.judge.finals.get(starts[-1], [])
                if finals and finals[0].phase is Phase.CONFIRMED and _started(line) == begun:
                    row.failures.append(f"{starts[-1]} is said to be confirmed, but nothing was started")
                line.command(STARTED, "stop")
                await asyncio.sleep(REST_S)
            self._judge(row, line, starts)

    def _judge(self, row: Row, line: VirtualLine, starts: list[str]) -> None:
        judge = line.judge
        allowed = (
            1 + int(self.corrupted_share * line.transactions / UNDETECTED) if self.corrupted_share else 0
        )
        false_values = {what: number for what, number in judge.false.items() if what.startswith("value")}
        false_states = {what: number for what, number in judge.false.items() if what.startswith("state")}
        finals = [judge.finals[id_][0] for id_ in starts if id_ in judge.finals]
        confirmed = sum(final.phase is Phase.CONFIRMED for final in finals)
        frames = max(len(unit.start_frames) for unit in line.bus.units if unit.family == STARTED)
        for is_right, what in (
            (sum(false_values.values()) <= allowed, f"shown as good, never had: {list(false_values)[:3]}"),
            (not false_states, f"false states: {false_states}"),
            (not line.trips(), f"watchdogs tripped: {line.trips()[:3]}"),
            (frames <= len(starts), f"{frames} start frames for {len(starts)} commands"),
            (all(len(each) == 1 for each in judge.finals.values()), "a command with several final results"),
            (not self.names or judge.codes[self.names] > 0, f"{self.names} was not reported"),
            (confirmed > 0 or not self.is_legible, "no start was confirmed"),
        ):
            if not is_right:
                row.failures.append(what)
        kinds = {each.kind for each in line.bus.violations}
        collisions = kinds <= {"collision"} and not self.is_legible
        if kinds and not (collisions or self.names):
            row.failures.append(f"line violations: {line.bus.violations[:3]}")
        row.measurements = {"transactions": line.transactions, "starts": len(starts), "confirmed": confirmed}
        row.measurements |= {"false values": sum(false_values.values()), "watchdog_s": line.watchdog_s}


def _started(line: VirtualLine) -> int:
    return sum(len(unit.starts) for unit in line.bus.units if unit.family == STARTED)


def errors(share: float) -> Callable[[VirtualLine], None]:
    """Corrupt this share of all replies."""

    def corrupt(line: VirtualLine) -> None:
        for unit in line.bus.units:
            line.bus.impair(unit.address, Noisy(0.02), chance=share)

    return corrupt


def late(line: VirtualLine) -> None:
    """Let one reply in twenty come after its time-out."""
    for unit in line.bus.units:
        line.bus.impair(unit.address, Late(2.0), chance=0.05)


def babbling(line: VirtualLine) -> None:
    """Let one starter talk without being asked."""
    line.bus.impair(1 + FAMILIES.index("sst"), Babbling(every_s=0.5))


def twins(line: VirtualLine) -> None:
    """Give one address to two starters of the same family."""
    address = 1 + FAMILIES.index("ssw06")
    twin = make_unit("ssw06", address, seed=99, settings={P_TIMEOUT: 0})
    line.judge.truths["ssw06"].append(Truth(twin, "ssw06", "ssw06", make_unit("ssw06", address, seed=99)))
    line.bus.add(twin)


SCENARIOS = (
    NoiseScenario("errors 1 %", errors(0.01), corrupted_share=0.01),
    NoiseScenario("errors 3 %", errors(0.03), corrupted_share=0.03),
    NoiseScenario("errors 10 %", errors(0.10), corrupted_share=0.10),
    NoiseScenario("late replies", late),
    NoiseScenario("babbling starter", babbling, names="babbling"),
    NoiseScenario("two with one address", twins, names="address_conflict"),
)
