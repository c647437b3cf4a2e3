"""How long a unit receives nothing when the gateway crashes or hangs, from numbers alone.

Units with a watchdog of their own stop their motors when no valid request comes for too long. The gap after a
failure is: what had passed since the last request, until the failure is noticed, until the program runs
again, and until the unit's slot comes in the first round.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import inf

from gateway.line.rtu.transaction import ALLOWANCE_S, longest_s, request_wire_s
from gateway.line.scheduler.requests import Poll
from gateway.modbus import LineTiming

# From the start of the process to the first request. Measured on two idle virtual processors, with 247
# starters: 0.57 and 0.86 s. On a fifth of one it is 2.5 to 3.6 s (docs/performance.md): more than this value.
START_UP_S = 2.0

FEEDS = 8  # the service watchdog is fed so many times within its limit, while every line moves
LOOK_S = 0.25  # how often the gateway looks whether every line has moved
WIDE_FACTOR = 1.5  # what a watchdog should be longer than the longest gap, for retries and chance


@dataclass(frozen=True, slots=True)
class Restart:
    """The service manager's reaction to a failed gateway; the defaults are those of the shipped unit."""

    restart_s: float = 0.5  # RestartSec
    watchdog_s: float = 10.0  # WatchdogSec
    abort_s: float = 2.0  # TimeoutAbortSec: until a process that does not die of SIGABRT is killed
    start_up_s: float = START_UP_S

    @property
    def noticed_s(self) -> float:
        """Return how long a hang lasts at most before the manager has ended it."""
        return self.watchdog_s * (1.0 + 1.0 / FEEDS) + LOOK_S + self.abort_s


@dataclass(frozen=True, slots=True)
class Gaps:
    """The longest times without a valid request to one unit."""

    regular_s: float  # everything works
    crash_s: float  # the process dies
    hang_s: float  # the process stands still until the manager ends it

    @property
    def wanted_s(self) -> tuple[float, float]:
        """Return how long a unit's watchdog must be to outlast a crash, and a hang, with room to spare."""
        return WIDE_FACTOR * self.crash_s, WIDE_FACTOR * self.hang_s


def first_requests_s(
    polls: Iterable[Poll],
    timing: LineTiming,
    *,
    limits_s: Mapping[int, float],
    allowance_s: float = ALLOWANCE_S,
) -> dict[int, float]:
    """Return by unit when at the latest it has received its first request after the port is open.

    Units with the shortest watchdogs are asked first (`PollTable.begin`), each by its first poll; none of
    those before may answer. Commands come on top.
    """
    firsts: dict[int, Poll] = {}
    for poll in polls:
        firsts.setdefault(poll.unit, poll)
    found_s: dict[int, float] = {}
    passed_s = timing.silence_s
    for poll in sorted(firsts.values(), key=lambda poll: limits_s.get(poll.unit) or inf):
        found_s[poll.unit] = passed_s + request_wire_s(poll.request, timing)
        passed_s += timing.silence_s + longest_s(
            poll.request, timing, response_time_s=poll.response_time_s, allowance_s=allowance_s
        )
    return found_s


def gaps_of(regular_s: float, first_s: float, restart: Restart | None = None) -> Gaps:
    """Return a unit's gaps; `regular_s` is of `Forecast.gaps_s`, `first_s` from `first_requests_s`."""
    manager = restart or Restart()
    again_s = manager.restart_s + manager.start_up_s + first_s
    return Gaps(regular_s, regular_s + again_s, regular_s + manager.noticed_s + again_s)
