"""Waiting for what other processes and sockets do."""

from __future__ import annotations

import asyncio
from collections.abc import Callable


async def until(
    is_so: Callable[[], object], what: str | Callable[[], str] = "it is so", within_s: float = 20.0
) -> None:
    """Wait until something is so; AssertionError says what never was, as it is known by then."""
    try:
        async with asyncio.timeout(within_s):
            while not is_so():  # noqa: ASYNC110 - none of these sets an event
                await asyncio.sleep(0.02)
    except TimeoutError:
        text = what if isinstance(what, str) else what()
        raise AssertionError(f"not within {within_s:g} s: {text}") from None
