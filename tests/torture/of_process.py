"""The process is killed, stopped, made to stumble, and robbed of its log."""

from __future__ import annotations

import asyncio
import fcntl
import os
import signal
import time

from tests.torture.scenario import Place, Scenario
from tests.torture.world import World

STUMBLE_SHARE = 0.8  # of the service watchdog's limit: more than half, less than all
TOLD_EVERY_S = 30.0  # a state that does not change
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
    w.figures |= {"right again s": round(longest_s, 2), "gap s": await w.longest_gap_s()}
    w.figures["computed s"] = round(w.gaps.crash_s, 2)
    w.check(w.figures["gap s"] <= w.gaps.crash_s, "a crash's gap was longer than computed")


async def sigstop(w: World, count: int) -> None:
    """Let it stand still until the service watchdog ends it."""
    for number in range(1, count + 1):
        await asyncio.sleep(w.dice.uniform(0.5, 1.5))
        await w.after_death(signal.SIGSTOP, within_s=w.gateway.restart.noticed_s + 10.0)
        w.check(w.gateway.lives[-2].is_hung, "the watchdog did not end a gateway that stood still")
        dumps = w.gateway.log.count("Fatal Python error: Aborted")
        w.check(dumps == number, f"{dumps} of {number} hangs dumped their stacks")
    w.figures |= {"gap s": await w.longest_gap_s(), "computed s": round(w.gaps.hang_s, 2)}
    w.check(w.figures["gap s"] <= w.gaps.hang_s, "a hang's gap was longer than computed")


async def stumble(w: World, count: int) -> None:
    """Let it stand still for most of the service watchdog's limit, then go on."""
    lives = len(w.gateway.lives)
    await asyncio.sleep(1.0)
    for _ in range(count):
        w.gateway.signal(signal.SIGSTOP)
        await asyncio.sleep(STUMBLE_SHARE * w.gateway.restart.watchdog_s)
        w.gateway.signal(signal.SIGCONT)
        await asyncio.sleep(2.0)
        await w.right_still()
    w.check(len(w.gateway.lives) == lives, "a stumble was taken for a hang")
    w.check("Timeout (" in w.gateway.log, "a stumble dumped no stacks")
    w.check("stood still" in w.gateway.log, "a stumble was not told in the log")
    w.check(" s late" in w.gateway.log, "no loop's delay was told in the log")


async def unread_log(w: World, seconds: int) -> None:
    """There is much to say, but the log's pipe is full and nobody reads it."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        w.broker.restart()
        await asyncio.sleep(1.0)
    await w.right(since_s=end_s - 1.0, within_s=TOLD_EVERY_S)
    await w.check_line_kept_time("the line waited for the log")


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
    Scenario("SIGKILL", Place.CRASH, sigkill, 300, 3, "times"),
    Scenario("SIGSTOP", Place.HANG, sigstop, 20, 1, "times"),
    Scenario("stumble", Place.HANG, stumble, 10, 1, "times"),
    Scenario("log not read", Place.LOG, unread_log, 60, 3, "s"),
)
