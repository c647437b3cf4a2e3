"""The process is killed, stopped, and hangs."""

from __future__ import annotations

import asyncio
import signal

from tests.lab.torture.blockable import LOOPS
from tests.lab.torture.scenario import CRASH, HANG, Scenario
from tests.lab.torture.world import World

BLOCKED_S = 30.0
ABORTED = "Aborted"  # [faulthandler]; in pieces, between which those of another dump may stand
BLOCKS_IN = "tests/lab/torture/blockable.py"


async def sigkill(w: World, count: int) -> None:
    """Kill at random points, a motor running; every third time right after a start was commanded."""
    await w.start("pump")
    longest_s = 0.0
    for number in range(count):
        await asyncio.sleep(w.dice.uniform(0.0, 1.5))
        starter = w.dice.choice(("fan", "mill"))
        is_starting = number % 3 == 2
        if is_starting:
            w.begin_start(starter)
            await asyncio.sleep(w.dice.uniform(0.0, 0.1))  # between ledger, line, read-back and result
        longest_s = max(longest_s, await w.next_life(lambda: w.gateway.signal(signal.SIGKILL)))
        if is_starting:
            await w.stop(starter)
    await w.stop("pump")
    w.row.measurements["right again s"] = round(longest_s, 2)
    await w.check_gap(w.gaps.crash_s, "a crash's gap was longer than computed")


async def sigstop(w: World, count: int) -> None:
    """Let it stand still until the service watchdog ends it."""
    await _hang(w, count, ("",))


async def blocked(w: World, count: int) -> None:
    """Block one loop, or the interpreter, for longer than the service watchdog waits."""
    await _hang(w, count, LOOPS)
    w.check(BLOCKS_IN in w.gateway.log, "the stacks do not say where it hangs")


async def _hang(w: World, count: int, loops: tuple[str, ...]) -> None:
    """Let a loop hang, or stop all of it; the watchdog ends it, and its stacks are in the log."""
    for number in range(count):
        loop = loops[number % len(loops)]

        def begin(loop: str = loop) -> None:
            if loop:
                w.gateway.block(loop, BLOCKED_S)
            else:
                w.gateway.signal(signal.SIGSTOP)

        await asyncio.sleep(w.dice.uniform(0.5, 1.5))
        aborts = w.gateway.log.count(ABORTED)
        await w.next_life(begin, within_s=w.gateway.restart.noticed_s + 10.0)
        w.check(w.gateway.lives[-2].is_hung, "the watchdog did not end a gateway that stood still")
        w.check(w.gateway.log.count(ABORTED) == aborts + 1, "a hang did not dump its stacks at its end")
    await w.check_gap(w.gaps.hang_s, "a hang's gap was longer than computed")


SCENARIOS = (
    Scenario("SIGKILL", CRASH, sigkill, 300, 3, "times"),
    Scenario("SIGSTOP", HANG, sigstop, 20, 1, "times"),
    Scenario("loop blocked", HANG, blocked, 21, 3, "times"),
)
