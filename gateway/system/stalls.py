"""Stalls: a late event loop; a process or machine that was suspended, whose messages are old then."""

from __future__ import annotations

import asyncio
import bisect
import math
from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import NamedTuple

from gateway.system.clock import Clock, ClockReading

TICK_S = 0.25
LAG_BOUNDS_S = (0.001, 0.002, 0.005, 0.01, 0.05, 0.25, 1.0)
SUSPEND_LIMIT_S = 2.0  # below any command's default validity, above a busy machine's worst delay
LOOK_EVERY_S = 0.25


class Delays(NamedTuple):
    """How many delays were how long: `counts` by upper bound, the last of those beyond them all."""

    bounds_s: tuple[float, ...]
    counts: tuple[int, ...]
    total_s: float

    @property
    def within(self) -> list[int]:
        """Return how many were at most as long as each bound; the last: how many there were."""
        return list(accumulate(self.counts))


class DelayCounts:
    """Counts delays by how long they were; noted by one thread, taken by any."""

    def __init__(self, bounds_s: Sequence[float]) -> None:
        self._bounds_s = tuple(bounds_s)
        self._counts = [0] * (len(bounds_s) + 1)
        self._total_s = 0.0

    def note(self, delay_s: float) -> None:
        """Count one."""
        self._counts[bisect.bisect_left(self._bounds_s, delay_s)] += 1
        self._total_s += delay_s

    def taken(self) -> Delays:
        """Return all that were counted so far."""
        return Delays(self._bounds_s, tuple(self._counts), self._total_s)


class LagMeter:
    """The worst delay of one loop. `run` belongs to that loop; the rest may be read from anywhere.

    A loop that stood still for some time shows that time, less up to one tick.
    """

    def __init__(self) -> None:
        self._worst_s = 0.0  # since it was taken
        self.delays = DelayCounts(LAG_BOUNDS_S)  # of each tick

    def take_worst_s(self) -> float:
        """Return the worst delay since the last call."""
        worst_s, self._worst_s = self._worst_s, 0.0
        return worst_s

    def note(self, delay_s: float) -> None:
        """Record one delay."""
        self.delays.note(delay_s)
        if delay_s > self._worst_s:
            self._worst_s = delay_s

    async def run(self) -> None:
        """Measure until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            due_s = loop.time() + TICK_S
            await asyncio.sleep(TICK_S)
            self.note(max(loop.time() - due_s, 0.0))


class SuspendWatch:
    """Looks at two clocks again and again: a gap between two looks was a suspension.

    A stopped process (SIGSTOP, a debugger, a starved machine) and one that slept with its machine show on the
    first clock. A virtual machine that was paused shows on the second only, when that clock is set.
    """

    def __init__(self, clock: Clock) -> None:
        self.on_suspended: Callable[[float], None] = lambda _: None  # gets how long it lasted
        self._clock = clock
        self._ended_s = -math.inf
        self._seen: ClockReading | None = None

    def look(self) -> None:
        """Notice a suspension that ended since the last look; to be called before any command is judged."""
        now = self._clock.reading()
        seen, self._seen = self._seen or now, now
        longest_s = max(now.up_s - seen.up_s, now.utc_s - seen.utc_s)
        if longest_s > SUSPEND_LIMIT_S:
            self._ended_s = self._clock.now_s()
            self.on_suspended(longest_s)

    def ended_s(self) -> float:
        """Look, and return when the latest suspension ended, on the steady clock."""
        self.look()
        return self._ended_s

    async def run(self, *, also: Callable[[], None]) -> None:
        """Look until cancelled, and call `also` each time."""
        while True:
            self.look()
            also()
            await asyncio.sleep(LOOK_EVERY_S)
