"""Asks simulated starters some of whose replies are lost or late, through a whole line in virtual time."""

from __future__ import annotations

import asyncio
import random
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.line.events import LineEvent, PollResult
from gateway.line.line import Line
from gateway.line.rtu.outcome import Answered
from gateway.modbus.timing import Framing, LineTiming
from gateway.sim.bus.faults import Impairment, NoReply, Reply
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.factory import make_unit
from gateway.starters.setup import StarterSetup, polls_of
from tests.local_host import local_events
from tests.virtual_time import run_virtually

TIMING = LineTiming(19200, Framing.parse("8E1"))
ONE = ("ssw07",)
EIGHT = ("ssw07", "ssw06", "ssw900", "sst") * 2
LOST = NoReply()
IN_A_ROW = 4  # lost replies of one starter take it offline, asked ever less often meanwhile
COLD_S = 100.0  # until a line knows that it loses replies


@dataclass(frozen=True, slots=True)
class LateWithin:
    """Answers at any time up to then."""

    longest_s: float = 10.0

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        """Return the reply after some time."""
        return (replace(reply, after_s=dice.uniform(reply.after_s, self.longest_s)),)


@dataclass(frozen=True, slots=True)
class LossMeasurement:
    """What came of some minutes."""

    answers: int
    statuses: int
    longest_s: float  # between two answers to one status poll, unless `IN_A_ROW` were lost there
    longest_cold_s: float  # the same in the first `COLD_S`
    longest_of_all_s: float  # however many were lost
    late_answers: int  # after that


class _Gap(NamedTuple):
    """Between two answers to one status poll."""

    begin_s: float
    end_s: float
    lost: int  # replies of its starter

    @property
    def length_s(self) -> float:
        return self.end_s - self.begin_s


def ask(
    families: tuple[str, ...],
    share: float,
    *,
    fault: Impairment = LOST,
    every_s: float = 0.25,
    for_s: float = 600.0,
    seed: int = 1,
) -> LossMeasurement:
    """Poll starters of these families, this share of all replies being faulty."""
    setups = [
        StarterSetup(f"x{at}", "x", at, load_profile(family), Variant(), every_s=every_s, timing=TIMING)
        for at, family in enumerate(families, 1)
    ]
    polls = [poll for setup in setups for poll in polls_of(setup)]
    answered_s: dict[str, list[float]] = {poll.key: [] for poll in polls}
    lost_s: dict[int, list[float]] = {setup.address: [] for setup in setups}

    def note(event: LineEvent) -> None:
        if isinstance(event, PollResult):
            times = answered_s[event.key] if isinstance(event.outcome, Answered) else lost_s[event.unit]
            times.append(asyncio.get_running_loop().time())

    async def scenario() -> None:
        units = [make_unit(family, at) for at, family in enumerate(families, 1)]
        bus = SimulatedLine(TIMING, units, seed=seed, chunk_bytes=None if fault is LOST else 1)
        if share:
            for setup in setups:
                bus.impair(setup.address, fault, chance=share)
        line = Line(name="x", opener=bus.opener(), timing=TIMING, polls=polls, events=local_events(note))
        serving = asyncio.create_task(line.run())
        await asyncio.sleep(for_s)
        serving.cancel()
        await asyncio.wait([serving])

    run_virtually(scenario())

    statuses = [(poll.unit, answered_s[poll.key]) for poll in polls if poll.group == "status"]
    every_gap = [
        _Gap(before, later, sum(before < at_s <= later for at_s in lost_s[unit]))
        for unit, times in statuses
        for before, later in pairwise([0.0, *times, for_s])
    ]
    gaps = [gap for gap in every_gap if gap.lost < IN_A_ROW]
    every = [at_s for times in answered_s.values() for at_s in times]
    return LossMeasurement(
        answers=len(every),
        statuses=sum(len(times) for _, times in statuses),
        longest_s=max(gap.length_s for gap in gaps if gap.end_s > COLD_S),
        longest_cold_s=max(gap.length_s for gap in gaps if gap.end_s <= COLD_S),
        longest_of_all_s=max(gap.length_s for gap in every_gap),
        late_answers=sum(at_s > COLD_S for at_s in every),
    )


def table(*, for_s: float = 600.0) -> list[str]:
    """Return a row for each kind of line: what it gives of the answers without faults."""
    lines = []
    for name, families, every_s in (
        ("1 SSW-07", ONE, 0.25),
        ("8 mixed", EIGHT, 0.25),
        ("1 SSW-07", ONE, 1.0),
    ):
        whole = ask(families, 0.0, every_s=every_s, for_s=for_s)
        lines.append(_row(f"{name} every {every_s} s, no faults", whole, whole))
        for lost in (0.01, 0.05, 0.10):
            seen = ask(families, lost, every_s=every_s, for_s=for_s)
            lines.append(_row(f"{name} every {every_s} s, {lost:.0%} lost", seen, whole))
        seen = ask(families, 0.05, fault=LateWithin(), every_s=every_s, for_s=for_s)
        lines.append(_row(f"{name} every {every_s} s, 5% late", seen, whole))
    return lines


def _row(name: str, seen: LossMeasurement, whole: LossMeasurement) -> str:
    return (
        f"{name}: {seen.answers / whole.answers:.3f} of the answers, "
        f"{seen.statuses / whole.statuses:.3f} of the statuses, longest {seen.longest_s:.2f} s; "
        f"after {COLD_S:.0f} s {seen.late_answers / whole.late_answers:.3f}, "
        f"before: longest {seen.longest_cold_s:.2f} s"
    )


if __name__ == "__main__":
    print("\n".join(table()))  # noqa: T201
