"""Waiting for what other processes and sockets do."""

from __future__ import annotations

import asyncio
from collections.abc import Callable


async def until(is_so: Callable[[], object], what: str = "it is so", within_s: float = 20.0) -> None:
    """Wait until something is so; AssertionError says what never was."""
    try:
        async with asyncio.timeout(within_s):
            while not is_so():  # noqa: ASYNC110 - none of these sets an event
                await asyncio.sleep(0.02)
    except TimeoutError:
        raise AssertionError(f"not within {within_s:g} s: {what}") from None
