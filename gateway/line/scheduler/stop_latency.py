"""TODO"""

from __future__ import annotations

from collections.abc import Iterable

from gateway.line.rtu.timeouts import ALLOWANCE_S, longest_s
from gateway.line.scheduler.requests import Poll
from gateway.modbus.timing import LineTiming


def worst_stop_latency_s(
    polls: Iterable[Poll], timing: LineTiming, *, allowance_s: float = ALLOWANCE_S
) -> float:
    """Return the longest time from a stop's submission to its first byte while these polls are asked."""
    waits_s = (
        longest_s(request, timing, response_time_s=poll.response_time_s, allowance_s=allowance_s)
        for poll in polls
        for request in (poll.request, *(other for other, _ in poll.alternates_of(poll.request)))
    )
    return max(waits_s, default=0.0) + timing.silence_s
