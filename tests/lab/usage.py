"""What Linux knows of a process: its processor time, memory, threads and open files."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import NamedTuple

LOOKS, LOOK_EVERY_S = 5, 0.02


class Usage(NamedTuple):
    """What processes have used so far, and hold."""

    cpu_s: float  # of all threads, to the nanosecond
    rss_kib: int
    most_kib: int = 0  # of memory, so far
    threads: int = 0

    def __add__(self, other: tuple[object, ...]) -> Usage:
        """Return both together."""
        assert isinstance(other, Usage)
        return Usage(*(mine + theirs for mine, theirs in zip(self, other, strict=True)))


def usage(pid: int) -> Usage:
    """Return what a process uses now; OSError when it has ended."""
    tasks = Path(f"/proc/{pid}/task").glob("*/schedstat")
    cpu_s = sum(int(task.read_text().split()[0]) for task in tasks) / 1e9
    lines = (line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text("utf-8").splitlines())
    status = {name: text.split() for name, text in lines}
    kib = (int(status[name][0]) for name in ("VmRSS", "VmHWM"))
    return Usage(cpu_s, *kib, int(status["Threads"][0]))


def open_files(pid: int) -> int:
    """Return how many files are open, the least of some looks: one that is being written goes again."""

    def look() -> int:
        time.sleep(LOOK_EVERY_S)
        return len(os.listdir(f"/proc/{pid}/fd"))

    return min(look() for _ in range(LOOKS))
