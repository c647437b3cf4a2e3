"""Memory: full collections of garbage are rare, since one stops all threads; malloc has one arena."""

from __future__ import annotations

import asyncio
import ctypes
import gc
from contextlib import suppress

# New objects until the youngest are looked through, and how many times until the next older ones are. With
# Python's 700, 10, 10 a line with 32 starters was stopped for 2 to 5 ms in 25 s, with these for 1 ms.
THRESHOLDS = (100, 20, 100)
SETTLED_S = (60.0, 180.0)  # after a start: all starters are identified by then; what is known of them stays


_M_ARENA_MAX = -8  # malloc.h of glibc


def use_one_arena() -> None:
    """Have all threads share malloc's memory; call before any is begun.

    Else glibc gives each thread an arena of its own, and what is freed in one is of no use to the others:
    2 MB with 247 starters. They hardly ever contend for it, since only one runs Python at a time.
    """
    with suppress(OSError, AttributeError):  # not glibc's malloc
        ctypes.CDLL(None).mallopt(_M_ARENA_MAX, 1)


class TunedCollector:
    """Freezes long-lived objects, so that collections skip them; belongs to the app's loop."""

    def __init__(self) -> None:
        self._before = gc.get_threshold()
        self._timers: list[asyncio.TimerHandle] = []

    def spare(self) -> None:
        """Begin with one full collection."""
        self._before = gc.get_threshold()
        gc.set_threshold(*THRESHOLDS)
        spare_what_lives(with_look=True)
        loop = asyncio.get_running_loop()
        self._timers = [loop.call_later(after_s, gc.freeze) for after_s in SETTLED_S]

    def end(self) -> None:
        """Restore Python's own settings."""
        for timer in self._timers:
            timer.cancel()
        gc.unfreeze()
        gc.set_threshold(*self._before)


def spare_what_lives(*, with_look: bool) -> None:
    """Freeze the objects that exist now; the full collection before that stops every loop."""
    if with_look:
        gc.unfreeze()
        gc.collect()
    gc.freeze()
