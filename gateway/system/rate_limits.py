"""How often something is done or said.

`Bucket` is a token bucket; `Damped` passes one item per interval and counts the others; `HoldOff` passes the
first after a quiet time; `ChangeDetector` passes what is new; `Backoff` has the growing
pauses between attempts.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from math import inf
from typing import Generic, TypeVar

from gateway.system.clock import Clock

REFUSAL_EVERY_S = 0.1  # refusals to one client

T = TypeVar("T")


class Damped(Generic[T]):
    """Of each key at most one item in `every_s`; keys must come from a bounded set.

    `pass_on` gets an item with 0, or the last of several with their number.
    """

    def __init__(self, pass_on: Callable[[T, int], None], *, clock: Clock, every_s: float) -> None:
        self._pass_on = pass_on
        self._clock = clock
        self._every_s = every_s
        self._passed_s: dict[Hashable, float] = {}
        self._counted: dict[Hashable, tuple[T, int]] = {}  # the last of those since then, and their number
        self._timers: dict[Hashable, asyncio.TimerHandle] = {}

    def put(self, key: Hashable, item: T) -> None:
        """Pass an item on now, or count it."""
        now_s = self._clock.now_s()
        if key not in self._counted and now_s - self._passed_s.get(key, -inf) >= self._every_s:
            self._passed_s[key] = now_s
            self._pass_on(item, 0)
            return
        _, count = self._counted.get(key, (item, 0))
        self._counted[key] = item, count + 1
        if not count:
            loop = asyncio.get_running_loop()
            self._timers[key] = loop.call_later(self._every_s, self._pass_number_on, key)

    def close(self) -> None:
        """Pass on now what has only been counted."""
        for key, timer in tuple(self._timers.items()):
            timer.cancel()
            self._pass_number_on(key)

    def _pass_number_on(self, key: Hashable) -> None:
        del self._timers[key]
        self._passed_s[key] = self._clock.now_s()
        self._pass_on(*self._counted.pop(key))


@dataclass(frozen=True, slots=True)
class Rate:
    """So many a second on average, so many at once."""

    per_s: float
    burst: int


class Bucket:
    """A token bucket: full at the beginning."""

    def __init__(self, rate: Rate) -> None:
        self._rate = rate
        self._tokens = float(rate.burst)
        self._at_s: float | None = None

    def take(self, now_s: float) -> bool:
        """Take a token; return whether there was one."""
        if self._at_s is not None:
            gained = (now_s - self._at_s) * self._rate.per_s
            self._tokens = min(self._tokens + gained, float(self._rate.burst))
        self._at_s = now_s
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True


class ChangeDetector:
    """Knows what was said last."""

    def __init__(self, said: object = None) -> None:
        self._said = said

    def is_new(self, what: object) -> bool:
        """Return whether this differs from what was said last, and count it as said."""
        is_new = what != self._said
        self._said = what
        return is_new


class HoldOff:
    """Sounds for the first of several, and again only once it was quiet for long enough."""

    def __init__(self, quiet_s: float) -> None:
        self._quiet_s = quiet_s
        self._last_s = -inf

    def sounds(self, now_s: float) -> bool:
        """Count one, and return whether it is worth saying."""
        is_quiet = now_s - self._last_s >= self._quiet_s
        self._last_s = now_s
        return is_quiet


class Backoff:
    """The pauses between attempts; with a seed each but the shortest is up to a quarter shorter.

    So many gateways do not reconnect in step.
    """

    def __init__(self, first_s: float, longest_s: float, *, seed: int | None = None) -> None:
        self._first_s = first_s
        self._longest_s = longest_s
        self._chance = None if seed is None else random.Random(seed)
        self._next_s = first_s

    def next_s(self) -> float:
        """Return how long to wait before the next attempt."""
        pause_s = min(self._next_s, self._longest_s)
        self._next_s = 2.0 * pause_s
        if self._chance is not None:
            pause_s *= 1 - 0.25 * self._chance.random()
        return max(pause_s, self._first_s)

    def reset(self) -> None:
        """Begin again with the shortest pause."""
        self._next_s = self._first_s
