"""What would let a line keep the watchdogs of its starters: another rate, fewer starters, other times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import get_args

from gateway.config.schema import Baud, LineTable
from gateway.config.setups import setups_of, timing_of
from gateway.line.forecast import forecast, longest_gap_s
from gateway.line.job import Poll
from gateway.modbus.timing import LineTiming
from gateway.starters.polling import polls_of

LONGEST_WATCHDOG_S = 1000.0


def mend_of(line: LineTable) -> str:
    """Return, in words, each single change after which every watchdog of the line is kept."""
    setups = [setup for setup in setups_of(line) if setup.is_enabled]
    polls = [poll for setup in setups for poll in polls_of(setup)]
    timing = timing_of(line)
    allowance_s = line.adapter_allowance_s
    found = []
    allowed = [set(setup.profile.bauds) for setup in setups if setup.profile.bauds]
    for baud in sorted(each for each in get_args(Baud) if each > line.baud):
        is_allowed = all(baud in bauds for bauds in allowed)
        if is_allowed and _is_kept(polls, LineTiming(baud, timing.framing), allowance_s):
            found.append(f"baud = {baud}")
            break
    units = list(dict.fromkeys(poll.unit for poll in polls))
    stay = _most(
        len(units),
        lambda count: _is_kept([p for p in polls if p.unit in units[:count]], timing, allowance_s),
    )
    if stay:
        found.append(f"{len(units) - stay} of its {len(units)} starters on another line")
    shortest = _least(lambda limit_s: _is_kept(_with_watchdogs(polls, limit_s), timing, allowance_s))
    if shortest is not None:
        found.append(f"no watchdog below {shortest:g} s")
    return ", or ".join(found)


def _is_kept(polls: Sequence[Poll], timing: LineTiming, allowance_s: float) -> bool:
    prospect = forecast(polls, timing, allowance_s=allowance_s)
    return all(longest_gap_s(prospect, poll.unit) <= poll.deadline_s for poll in polls if poll.deadline_s)


def _with_watchdogs(polls: Sequence[Poll], least_s: float) -> list[Poll]:
    return [
        replace(poll, deadline_s=max(poll.deadline_s, least_s)) if poll.deadline_s else poll for poll in polls
    ]


def _most(count: int, is_kept: Callable[[int], bool]) -> int:
    """Return the largest number below `count` for which it is kept; 0 when it is for none."""
    low, high = 0, count
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if is_kept(middle) else (low, middle)
    return low


def _least(is_kept: Callable[[float], bool]) -> float | None:
    """Return the shortest watchdog in whole seconds for which it is kept."""
    low, high = 0, int(LONGEST_WATCHDOG_S)
    if not is_kept(high):
        return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if is_kept(middle) else (middle, high)
    return float(high)
