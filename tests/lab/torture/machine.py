"""What the machine itself does to our clocks: the time for which it did not run our processes.

A promise in seconds holds for a gateway that gets a processor when it wants one. On a machine with other
work gateway, starters and broker wait for it, as do the kernel's workers that carry the bytes of pseudo
terminals. The kernel counts for how long each thread was ready to run and did not (run_delay,
[sched-stats.rst]), and for how long the host had taken the processors away (steal, [proc_stat(5)]). Of each
process the thread that waited longest counts. That much is taken off before anything is judged, and shown in
the report; a step in which it comes to half of what a line allows for a late reply is lost as a whole, and a
time of which more than half is lost proves nothing.
"""

from __future__ import annotations

import asyncio
import os
import threading
import time
from bisect import bisect_right
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

STEP_S = 0.05
RETAINED = 200_000  # steps: some hours
TICKS_PER_S = os.sysconf("SC_CLK_TCK")
LOST_FROM_S = 0.01  # half of gateway.line.rtu.transaction.ALLOWANCE_S
STEAL = 8  # the field in /proc/stat
WORKERS = "kworker/u"  # not bound to a processor
PTY_WORK = "events_unbound"  # what such a worker's name ends in while it flushes pseudo terminals
WORKERS_EVERY_S = 2.0  # how often to look who they are
LOOK_S = 0.01  # in which something is waited for
AT_MOST = 10  # times as long in real time, however busy the machine is
SLEPT_AT_MOST = 3

Thread = tuple[int, int]  # process and thread


class DelayMeter:
    """Adds up in a thread of its own for how long the children of this process were held up."""

    def __init__(self) -> None:
        self._thread: threading.Thread | None = None
        self._delays_s: dict[Thread, float] = {}
        self._stolen_s = 0.0
        self._sums_s = deque([(-1.0, 0.0)], maxlen=RETAINED)  # a time; held up until then, in all
        self._workers: list[int] = []
        self._workers_due_s = 0.0

    def start(self) -> None:
        """Begin; may be called again."""
        if self._thread is None:
            self._look(0.0)
            self._thread = threading.Thread(target=self._run, name="machine", daemon=True)
            self._thread.start()

    def held_s(self, from_s: float, to_s: float | None = None) -> float:
        """Return for how long somebody of us was held up between two times of the steady clock."""
        return self._sum_at(time.monotonic() if to_s is None else to_s) - self._sum_at(from_s)

    def is_unusable(self, from_s: float, to_s: float | None = None) -> bool:
        """Return whether the machine took more than half of this time: then it proves nothing."""
        to_s = time.monotonic() if to_s is None else to_s
        return self.held_s(from_s, to_s) > (to_s - from_s) / 2

    def took_s(self, from_s: float, to_s: float) -> float:
        """Return how long something took without the machine's part; nothing when that was most of it."""
        return 0.0 if self.is_unusable(from_s, to_s) else to_s - from_s - self.held_s(from_s, to_s)

    def fair_s(self) -> float:
        """Return a clock that stands while somebody of us is held up."""
        return time.monotonic() - self._sums_s[-1][1]

    def _sum_at(self, at_s: float) -> float:
        """Return what was held up until then: of a part of a step its share."""
        sums_s = list(self._sums_s)
        after = bisect_right(sums_s, at_s, key=lambda each: each[0])
        if after in (0, len(sums_s)):
            return sums_s[max(after - 1, 0)][1]
        (sooner_s, less_s), (later_s, more_s) = sums_s[after - 1], sums_s[after]
        return less_s + (more_s - less_s) * (at_s - sooner_s) / (later_s - sooner_s)

    def _run(self) -> None:
        before_s = time.monotonic()
        while True:
            time.sleep(STEP_S)
            now_s = time.monotonic()
            self._look(now_s - before_s)
            before_s = now_s

    def _look(self, passed_s: float) -> None:
        """Add what has come since the last look."""
        if time.monotonic() >= self._workers_due_s:
            self._workers, self._workers_due_s = _workers(), time.monotonic() + WORKERS_EVERY_S
        children, before_s = dict(_delays_s(_children())), self._delays_s
        workers = dict(_delays_s(self._workers))
        waited_s: defaultdict[int, float] = defaultdict(float)  # by process; all workers are one
        for thread, delay_s in children.items():
            waited_s[thread[0]] = max(waited_s[thread[0]], delay_s - before_s.get(thread, 0.0))
        for thread, delay_s in workers.items():  # a new one began long ago
            if _name(thread[0]).endswith(PTY_WORK):
                waited_s[0] = max(waited_s[0], delay_s - before_s.get(thread, delay_s))
        stolen_s = _stolen_s()
        held_s = sum(waited_s.values()) + stolen_s - self._stolen_s
        self._delays_s, self._stolen_s = children | workers, stolen_s
        sum_s = self._sums_s[-1][1] + (passed_s if held_s >= LOST_FROM_S else held_s)
        self._sums_s.append((time.monotonic(), sum_s))


def _delays_s(processes: list[int]) -> Iterator[tuple[Thread, float]]:
    """Return how long each thread has waited for a processor since it began."""
    for process in processes:
        with suppress(OSError, ValueError, IndexError):  # it has just ended
            for thread in os.listdir(f"/proc/{process}/task"):
                fields = Path(f"/proc/{process}/task/{thread}/schedstat").read_text("ascii").split()
                yield (process, int(thread)), int(fields[1]) / 1e9


def _children() -> list[int]:
    found: list[int] = []
    for thread in os.listdir("/proc/self/task"):
        with suppress(OSError):
            text = Path(f"/proc/self/task/{thread}/children").read_text("ascii")
            found.extend(int(each) for each in text.split())
    return found


def _workers() -> list[int]:
    processes = filter(str.isdecimal, os.listdir("/proc"))
    return [int(each) for each in processes if _name(each).startswith(WORKERS)]


def _name(process: int | str) -> str:
    """Return what a process is called; empty when it has ended."""
    with suppress(OSError):
        return Path(f"/proc/{process}/comm").read_text("utf-8").strip()
    return ""


def _stolen_s() -> float:
    with Path("/proc/stat").open(encoding="ascii") as file:
        return int(file.readline().split()[STEAL]) / TICKS_PER_S


MACHINE = DelayMeter()  # there is but one


async def sleep_fairly(seconds: float) -> None:
    """Sleep until so much has passed that the machine did not take."""
    MACHINE.start()
    end_s, last_s = MACHINE.fair_s() + seconds, time.monotonic() + SLEPT_AT_MOST * seconds
    with suppress(TimeoutError):
        await until(
            lambda: MACHINE.fair_s() >= end_s or time.monotonic() >= last_s, "it is over", within_s=seconds
        )


async def until(is_true: Callable[[], object], what: str, *, within_s: float) -> None:
    """Return once something is true; TimeoutError says what never came about.

    The limit does not count the time for which the machine did not run us.
    """
    MACHINE.start()
    begun_s, end_s = time.monotonic(), MACHINE.fair_s() + within_s
    while not is_true():
        is_over = MACHINE.fair_s() > end_s and not MACHINE.is_unusable(begun_s)
        if is_over or time.monotonic() > begun_s + AT_MOST * within_s:
            raise TimeoutError(f"not within {within_s:g} s: {what}")
        await asyncio.sleep(LOOK_S)
