"""How late waits end on this machine, and how long its disk takes; for `doctor`."""

from __future__ import annotations

import asyncio
import os
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

TIMERS, TIMER_S = 60, 0.004
SYNCS, SYNC_BYTES = 5, 4096


@dataclass(frozen=True, slots=True)
class BoxSpeed:
    """A machine's measurement."""

    timer_late_s: float  # the median of its waits' lateness,
    timer_worst_s: float  # and the worst
    sync_s: float | None  # the longest of some writes to state_dir that wait for the disk; None: not possible


async def measured(state_dir: Path) -> BoxSpeed:
    """Measure this machine; nothing may run beside it on this loop."""
    late_s = sorted([await _lateness_s() for _ in range(TIMERS)])
    return BoxSpeed(
        timer_late_s=round(late_s[len(late_s) // 2], 6),
        timer_worst_s=round(late_s[-1], 6),
        sync_s=_sync_s(state_dir),
    )


async def _lateness_s() -> float:
    """Return how much too late a wait ends that is as long as those of a line."""
    due_s = time.perf_counter() + TIMER_S
    await asyncio.sleep(TIMER_S)
    return max(time.perf_counter() - due_s, 0.0)


def _sync_s(state_dir: Path) -> float | None:
    """Return the longest of some writes that wait for the disk, as the command ledger does."""
    path = state_dir / "doctor.probe"
    longest_s = 0.0
    try:
        with path.open("wb") as file:
            for _ in range(SYNCS):
                begun_s = time.perf_counter()
                file.write(bytes(SYNC_BYTES))
                file.flush()
                os.fsync(file.fileno())
                longest_s = max(longest_s, time.perf_counter() - begun_s)
    except OSError:
        return None
    finally:
        with suppress(OSError):
            path.unlink()
    return round(longest_s, 6)
