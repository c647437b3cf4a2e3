"""How old a status becomes where replies are lost or late: `python -m tests.lab.lost_replies [SECONDS]`.

Simulated starters, which answer in the order in which they are asked, on a whole line in virtual time.
"""

from __future__ import annotations

import asyncio
import random
import sys
from dataclasses import dataclass, replace
from itertools import pairwise

from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.line.events import LineEvent, PollResult
from gateway.line.line import Line
from gateway.line.rtu.outcome import Answered
from gateway.modbus.timing import Framing, LineTiming
from gateway.sim.bus.faults import Impairment, NoReply, Reply
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.factory import make_unit
from gateway.starters import StarterSetup, polls_of
from tests.local_host import local_events
from tests.virtual_time import run_virtually

TIMING = LineTiming(19200, Framing.parse("8E1"))
LINES = (  # families, period
    ("1 SSW-07", ("ssw07",), 0.25),
    ("1 SSW-06", ("ssw06",), 0.25),
    ("8 mixed", ("ssw07", "ssw06", "ssw900", "sst") * 2, 1.0),
)


@dataclass(frozen=True, slots=True)
class LateWithin:
    """Answers at any time up to then."""

    longest_s: float

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        """Return the reply after some time."""
        return (replace(reply, after_s=dice.uniform(reply.after_s, self.longest_s)),)


FAULTS: tuple[tuple[str, float, Impairment], ...] = (
    ("none", 0.0, NoReply()),
    ("1 % lost", 0.01, NoReply()),
    ("5 % lost", 0.05, NoReply()),
    ("1 % late, up to 1 s", 0.01, LateWithin(1.0)),
    ("5 % late, up to 1 s", 0.05, LateWithin(1.0)),
    ("5 % late, up to 3 s", 0.05, LateWithin(3.0)),
)


def statuses(
    families: tuple[str, ...], every_s: float, share: float, fault: Impairment, for_s: float
) -> tuple[int, float]:
    """Return how many status polls were answered, and the longest time between two answers to one."""
    setups = [
        StarterSetup(f"x{at}", "x", at, load_profile(family), Variant(), every_s=every_s, timing=TIMING)
        for at, family in enumerate(families, 1)
    ]
    polls = [poll for setup in setups for poll in polls_of(setup)]
    answered_s: dict[str, list[float]] = {poll.key: [0.0] for poll in polls if poll.group == "status"}

    def note(event: LineEvent) -> None:
        if isinstance(event, PollResult) and isinstance(event.outcome, Answered) and event.key in answered_s:
            answered_s[event.key].append(event.outcome.at_s)

    async def scenario() -> None:
        units = [make_unit(family, at) for at, family in enumerate(families, 1)]
        bus = SimulatedLine(TIMING, units, seed=1, chunk_bytes=None)
        for setup in setups if share else ():
            bus.impair(setup.address, fault, chance=share)
        line = Line(name="x", opener=bus.opener(), timing=TIMING, polls=polls, events=local_events(note))
        serving = asyncio.create_task(line.run())
        await asyncio.sleep(for_s)
        serving.cancel()
        await asyncio.wait([serving])

    run_virtually(scenario())
    gaps_s = [after - before for times in answered_s.values() for before, after in pairwise([*times, for_s])]
    return sum(len(times) - 1 for times in answered_s.values()), max(gaps_s)


def main() -> None:
    """Print a row for each line and fault."""
    for_s = float(sys.argv[1]) if len(sys.argv) > 1 else 600.0
    for name, families, every_s in LINES:
        whole = 0
        for fault, share, by in FAULTS:
            answered, longest_s = statuses(families, every_s, share, by, for_s)
            whole = whole or answered
            row = f"{name}, {every_s:g} s | {fault} | {answered / whole:.2f} | {longest_s:.1f} s\n"
            sys.stdout.write(row)
            sys.stdout.flush()


if __name__ == "__main__":
    main()
