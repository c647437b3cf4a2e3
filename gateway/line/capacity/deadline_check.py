"""Whether a line keeps its units from their watchdogs: the one rule for `check`, `set` and reload; pure.

A watchdog is met when the longest time between two requests to its unit with commands under way, as
`forecast` promises it, is not longer than the watchdog's time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from gateway.line.capacity.line_forecast import Missed, forecast
from gateway.line.scheduler.requests import Poll
from gateway.modbus import LineTiming

LONGEST_LIMIT_S = 1000  # beyond what any family's watchdog can be set to (P314, C8.2.5.3, R41: 999 s)

Limits = Mapping[int, float | None]  # by unit: the time of its watchdog in seconds; None or 0: it has none


def missed_deadlines(polls: Sequence[Poll], timing: LineTiming, *, allowance_s: float) -> tuple[Missed, ...]:
    """Return the watchdogs that these polls would miss."""
    return forecast(polls, timing, allowance_s=allowance_s).missed


def with_deadlines(polls: Sequence[Poll], limits_s: Limits) -> list[Poll]:
    """Return the polls with these watchdogs instead of their own."""
    return [
        replace(poll, deadline_s=limits_s[poll.unit] or None) if poll.unit in limits_s else poll
        for poll in polls
    ]


def least_whole(holds: Callable[[float], bool], *, most: int = LONGEST_LIMIT_S) -> float | None:
    """Return the least whole number up to `most` from which on it holds; None when it holds for none."""
    low, high = 0, most
    if not holds(high):
        return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return float(high)
