"""Passes on what comes too often at a bounded rate, so that nothing is lost without a count."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

from gateway.clock import Clock
from gateway.starters.flood import Damper

T = TypeVar("T")


class Damped(Generic[T]):
    """Of each key at most one item in `every_s`; keys must come from a bounded set.

    `pass_on` gets an item with 0, or the last of several with their number.
    """

    def __init__(self, pass_on: Callable[[T, int], None], *, clock: Clock, every_s: float) -> None:
        self._pass_on = pass_on
        self._clock = clock
        self._every_s = every_s
        self._damper = Damper(every_s)
        self._last: dict[Hashable, T] = {}  # of those that were only counted
        self._timers: dict[Hashable, asyncio.TimerHandle] = {}

    def put(self, key: Hashable, item: T) -> None:
        """Pass an item on now, or count it."""
        if self._damper.passes(key, now_s=self._clock.now_s()):
            self._pass_on(item, 0)
            return
        self._last[key] = item
        if key not in self._timers:
            loop = asyncio.get_running_loop()
            self._timers[key] = loop.call_later(self._every_s, self._pass_number_on, key)

    def close(self) -> None:
        """Pass on now what has only been counted."""
        for key, timer in tuple(self._timers.items()):
            timer.cancel()
            self._pass_number_on(key)

    def _pass_number_on(self, key: Hashable) -> None:
        del self._timers[key]
        self._pass_on(self._last.pop(key), self._damper.take(key, now_s=self._clock.now_s()))
