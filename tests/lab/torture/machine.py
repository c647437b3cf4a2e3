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

import os
import threading
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Iterator
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


class DelayMeter:
    """Adds up in a thread of its own for how long the children of this process were held up."""

    def __init__(self) -> None:
        self._thread: threading.Thread | None = None
        self._delays_s: dict[tuple[int, int], float] = {}  # by process and thread
        self._stolen_s = 0.0
        self._sums_s: deque[tuple[float, float]] = deque(
            maxlen=RETAINED
        )  # a time; held up until then, in all
        self._sum_s = 0.0
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
        return self._sum_at(to_s) - self._sum_at(from_s)

    def is_unusable(self, from_s: float, to_s: float | None = None) -> bool:
        """Return whether the machine took more than half of this time: then it proves nothing."""
        passed_s = (time.monotonic() if to_s is None else to_s) - from_s
        return self.held_s(from_s, to_s) > passed_s / 2

    def fair_s(self) -> float:
        """Return a clock that stands while somebody of us is held up."""
        return time.monotonic() - self._sum_s

    def _sum_at(self, at_s: float | None) -> float:
        sums_s = list(self._sums_s)
        if not sums_s or at_s is None:
            return self._sum_s
        after = bisect_right(sums_s, at_s, key=lambda each: each[0])
        if after == 0:
            return sums_s[0][1]
        if after == len(sums_s):
            return sums_s[-1][1]
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
        children = _children()
        delays_s = dict(_delays_s((*children, *self._workers)))
        busy = {each for each in self._workers if _name(each).endswith(PTY_WORK)}
        waited_s: dict[int, float] = {}
        for key, delay_s in delays_s.items():
            is_new_worker = key not in self._delays_s and key[0] in self._workers  # it began long ago
            before_s = delay_s if is_new_worker else self._delays_s.get(key, 0.0)
            if key[0] in self._workers and key[0] not in busy:
                continue
            of = 0 if key[0] in busy else key[0]  # all workers are one
            waited_s[of] = max(waited_s.get(of, 0.0), delay_s - before_s)
        stolen_s = _stolen_s()
        held_s = sum(waited_s.values()) + stolen_s - self._stolen_s
        self._sum_s += passed_s if held_s >= LOST_FROM_S else held_s
        self._delays_s, self._stolen_s = delays_s, stolen_s
        self._sums_s.append((time.monotonic(), self._sum_s))


def _delays_s(processes: Iterable[int]) -> Iterator[tuple[tuple[int, int], float]]:
    """Return, by process and thread, how long it has waited for a processor since it began."""
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
        fields = file.readline().split()
    return int(fields[STEAL]) / TICKS_PER_S


MACHINE = DelayMeter()  # there is but one
