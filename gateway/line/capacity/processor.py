"""How much of a processor a site's lines take: an estimate for machines of any speed.

The constants were measured on one machine (`python -m tests.slow_box`, `python -m tests.bench --only cpu`),
decoding and publishing included. Another machine takes so many times as long as its slowness says, which
`doctor` measures. Both threads of the gateway share one interpreter, so that more processors do not help.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from gateway.line.capacity.forecast import Forecast
from gateway.line.rtu.reply_times import reply_within_s, request_wire_s
from gateway.modbus.timing import Framing, LineTiming

# Where slowness is 1:
BASE_SHARE = 0.035  # of a processor, whatever the gateway does,
STARTER_SHARE = 0.0001  # for each starter,
TRANSACTION_S = 0.0007  # and for each transaction
QUICK_S = 0.005  # the response time of starters that answer quickly
HELD_SHARE = 0.65  # of a processor: what is beyond it is for starts, pages, commands and a backlog

FULL_STARTERS = 32  # of the line that a machine's capacity is stated in
FULL_TIMING = LineTiming(19200, Framing("N", 2))
FULL_BYTES = 17  # of a request and its reply, as an SSW-07 is read: one to three registers


@dataclass(frozen=True, slots=True)
class LineDemand:
    """What one line asks of the processor."""

    per_s: float  # transactions
    starters: int


def demand_of(whole: Forecast, timing: LineTiming, *, starters: int) -> LineDemand:
    """Return what a line asks for at most: its starters answer quickly, and all its motors run."""
    polls = [each.poll for each in whole.polls]
    asked_per_s = sum(1 / poll.every_s for poll in polls if poll.every_s)
    quick_s = sum(
        timing.silence_s
        + request_wire_s(poll.request, timing)
        + reply_within_s(poll.request, timing, response_time_s=QUICK_S, allowance_s=0.0)
        for poll in polls
    )
    full_per_s = len(polls) / quick_s if polls else 0.0
    is_paced = all(poll.every_s for poll in polls)
    return LineDemand(min(asked_per_s, full_per_s) if is_paced else full_per_s, starters)


def processor_share(lines: Iterable[LineDemand], *, slowness: float) -> float:
    """Return the share of one processor that these lines take together; above 1 they are not met."""
    demands = tuple(lines)
    starters, per_s = sum(each.starters for each in demands), sum(each.per_s for each in demands)
    return (BASE_SHARE + STARTER_SHARE * starters + TRANSACTION_S * per_s) * slowness


def full_lines_held(*, slowness: float) -> int:
    """Return how many lines of FULL_STARTERS that are asked without a pause a machine holds; at most 247."""
    held = 0
    while held < 247 and processor_share([full_line()] * (held + 1), slowness=slowness) <= HELD_SHARE:
        held += 1
    return held


def full_line() -> LineDemand:
    """Return the line that a machine's capacity is stated in."""
    each_s = FULL_TIMING.wire_s(FULL_BYTES) + QUICK_S + FULL_TIMING.silence_s
    return LineDemand(1 / each_s, FULL_STARTERS)
