"""The process is killed, stopped, made to stumble, and robbed of its log."""

from __future__ import annotations

import asyncio
import fcntl
import os
import signal
import time
from collections.abc import Callable

from gateway.line.capacity.outage import FEEDS, LOOK_S
from tests.lab.torture.blockable import LOOPS
from tests.lab.torture.machine import MACHINE
from tests.lab.torture.scenario import Place, Scenario
from tests.lab.torture.world import World

BLOCKED_S = 30.0
ABORTED = "Aborted"  # [faulthandler]; in pieces, between which those of another dump may stand
BLOCKS_IN = "tests/lab/torture/blockable.py"
DUMPED = "Timeout ("  # [faulthandler.dump_traceback_later]
STATE_EVERY_S = 30.0  # a state that does not change
PIPE_BYTES = 4096
F_SETPIPE_SZ = 1031  # [linux/fcntl.h]


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
        longest_s = max(longest_s, await w.after_death(signal.SIGKILL))
        if is_starting:
            await w.stop(starter)
    await w.stop("pump")
    w.measurements["right again s"] = round(longest_s, 2)
    await w.check_gap(w.gaps.crash_s, "a crash's gap was longer than computed")


async def sigstop(w: World, count: int) -> None:
    """Let it stand still until the service watchdog ends it."""
    for _ in range(count):
        await asyncio.sleep(w.dice.uniform(0.5, 1.5))
        await _hang(w, lambda: w.gateway.signal(signal.SIGSTOP))
    await w.check_gap(w.gaps.hang_s, "a hang's gap was longer than computed")


async def blocked(w: World, count: int) -> None:
    """Block one loop, or the interpreter, for longer than the service watchdog waits."""
    for number in range(count):
        await asyncio.sleep(w.dice.uniform(0.5, 1.5))
        what = LOOPS[number % len(LOOPS)]
        before = w.gateway.log.count(DUMPED)
        await _hang(w, lambda what=what: w.gateway.block(what, BLOCKED_S))  # type: ignore[misc] # a default
        w.check(w.gateway.log.count(DUMPED) > before, f"{what} blocked: no stacks before the end")
    w.check(BLOCKS_IN in w.gateway.log, "the stacks do not say where it hangs")
    await w.check_gap(w.gaps.hang_s, "a hang's gap was longer than computed")


async def stumble(w: World, count: int) -> None:
    """Let loops, or all of it, stand still for most of the service watchdog's limit, then go on."""
    watchdog_s = w.gateway.restart.watchdog_s
    longest_s = watchdog_s * (1.0 - 1.0 / FEEDS) - 2 * LOOK_S  # the last sign of life was some time before
    await asyncio.sleep(2.0)
    for number in range(count):
        seconds = w.dice.uniform(watchdog_s / 2 + LOOK_S, longest_s)
        lives, begun_s = len(w.gateway.lives), time.monotonic()
        if number % 4 == 3:
            w.gateway.signal(signal.SIGSTOP)
            await asyncio.sleep(seconds)
            w.gateway.signal(signal.SIGCONT)
        else:
            w.gateway.block(LOOPS[number % 4], seconds)
            await asyncio.sleep(seconds)
        await asyncio.sleep(2.0)
        is_longer = seconds + MACHINE.held_s(begun_s) > longest_s  # it never was a mere stumble
        w.check(len(w.gateway.lives) == lives or is_longer, "a stumble was taken for a hang")
        await w.gateway.until_up(lives=lives)
        await w.right_still()
    w.check(DUMPED in w.gateway.log, "a stumble dumped no stacks")
    w.check("stood still" in w.gateway.log, "a suspension was not logged")
    w.check(" s late" in w.gateway.log, "no loop's delay was logged")


async def _hang(w: World, begin: Callable[[], None]) -> None:
    """Let it hang; the watchdog ends it, and its stacks are in the log."""
    aborts = w.gateway.log.count(ABORTED)
    await w.after_hang(begin)
    w.check(w.gateway.lives[-2].is_hung, "the watchdog did not end a gateway that stood still")
    w.check(w.gateway.log.count(ABORTED) == aborts + 1, "a hang did not dump its stacks at its end")


async def unread_log(w: World, seconds: int) -> None:
    """There is much to log, but the log's pipe is full and no process reads it."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        await asyncio.to_thread(w.broker.restart)
        await asyncio.sleep(1.0)
    await w.right(since_s=end_s - 1.0, within_s=STATE_EVERY_S)
    await w.check_line_timing("the line waited for the log")


def full_pipe() -> tuple[int, int]:
    """Return a pipe that takes no more bytes."""
    reading, writing = os.pipe()
    fcntl.fcntl(writing, F_SETPIPE_SZ, PIPE_BYTES)
    os.set_blocking(writing, False)
    try:
        while True:
            os.write(writing, b"x" * 512)
    except BlockingIOError:
        os.set_blocking(writing, True)
    return reading, writing


SCENARIOS = (
    Scenario("SIGKILL", Place.CRASH, sigkill, 300, 3, "times", quick=2),
    Scenario("SIGSTOP", Place.HANG, sigstop, 20, 1, "times"),
    Scenario("loop blocked", Place.HANG, blocked, 21, 3, "times", quick=1),
    Scenario("stumble", Place.HANG, stumble, 20, 4, "times", quick=1),
    Scenario("log not read", Place.LOG, unread_log, 60, 3, "s", quick=2),
)
