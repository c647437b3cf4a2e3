"""Waiting for what happens in other processes."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

STEP_S = 0.01


async def until(is_true: Callable[[], bool], what: str, *, within_s: float) -> None:
    """Return once something is true; TimeoutError says what never came about."""
    end_s = time.monotonic() + within_s
    while not is_true():
        if time.monotonic() > end_s:
            raise TimeoutError(f"not within {within_s:g} s: {what}")
        await asyncio.sleep(STEP_S)
