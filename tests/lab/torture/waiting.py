"""Waiting for what happens in other processes."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress

from tests.lab.torture.machine import MACHINE

STEP_S = 0.01
SLEPT_AT_MOST = 3  # times as long in real time
AT_MOST = 10  # times as long in real time, however busy the machine is


async def sleep_fairly(seconds: float) -> None:
    """Sleep until so much has passed that the machine did not take."""
    MACHINE.start()
    end_s, last_s = MACHINE.fair_s() + seconds, time.monotonic() + SLEPT_AT_MOST * seconds
    with suppress(TimeoutError):
        await until(
            lambda: MACHINE.fair_s() >= end_s or time.monotonic() >= last_s, "time passes", within_s=seconds
        )


async def until(is_true: Callable[[], bool], what: str, *, within_s: float) -> None:
    """Return once something is true; TimeoutError says what never came about.

    The limit does not count the time for which the machine did not run us.
    """
    MACHINE.start()
    begun_s, end_s = time.monotonic(), MACHINE.fair_s() + within_s
    while not is_true():
        is_over = MACHINE.fair_s() > end_s and not MACHINE.is_unusable(begun_s)
        if is_over or time.monotonic() > begun_s + AT_MOST * within_s:
            raise TimeoutError(f"not within {within_s:g} s: {what}")
        await asyncio.sleep(STEP_S)
