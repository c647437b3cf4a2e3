"""What would let a line keep what is asked of it: another rate, fewer starters, other times.

What `fast_words` would spare a line: the same values in fewer requests.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import ceil
from typing import get_args

from gateway.config.convert import setups_of, timing_of
from gateway.config.schema import Baud, LineTable
from gateway.line.capacity.deadline_check import LONGEST_LIMIT_S, missed_deadlines, with_deadlines
from gateway.line.capacity.forecast import forecast
from gateway.line.scheduler.requests import Poll
from gateway.modbus.timing import LineTiming
from gateway.starters.telemetry.polling import fast_polls_of, polls_of

LONGEST_EVERY_S = 3600.0


IsKept = Callable[[Sequence[Poll], LineTiming], bool]


def mend_of(line: LineTable) -> str:
    """Return, in words, each single change after which every watchdog of the line is kept.

    Fewer points are none: a watchdog's request goes before all polls, and is a starter's shortest.
    """
    polls = _polls_of(line)
    timing = timing_of(line)
    is_kept = partial(_keeps_watchdogs, allowance_s=line.adapter_allowance_s)
    found = _faster_or_fewer(line, polls, is_kept)
    shortest = _least(lambda limit_s: is_kept(_with_watchdogs(polls, limit_s), timing))
    if shortest is not None:
        found.append(f"no watchdog below {shortest:g} s")
    return ", or ".join(found)


def relief_of(line: LineTable) -> str:
    """Return, in words, each single change after which an over-full line keeps its periods."""
    found = _faster_or_fewer(line, _polls_of(line), _keeps_periods)
    periods_s = {starter.every_s for starter in line.starters if starter.enabled and starter.every_s}
    longest_s = max(periods_s)
    slower = _least(
        lambda tenths: _keeps_periods(_polls_of(_slower(line, tenths / 10)), timing_of(line)),
        most=int(10 * LONGEST_EVERY_S / longest_s),
    )
    if slower is not None:
        times = f"{slower / 10:g} times as long"
        found.append(
            f"every_s = {_rounded(longest_s * slower / 10):g}" if len(periods_s) == 1 else f"every_s {times}"
        )
    return ", or ".join(found)


def _slower(line: LineTable, factor: float) -> LineTable:
    """Return the line with every starter's period longer by a factor."""
    starters = (each.model_copy(update={"every_s": each.every_s * factor}) for each in line.starters)
    return line.model_copy(update={"starters": tuple(starters)})


def _rounded(every_s: float) -> float:
    return ceil(round(10 * every_s, 6)) / 10


def _polls_of(line: LineTable) -> list[Poll]:
    return [poll for setup in setups_of(line) for poll in polls_of(setup)]


def _faster_or_fewer(line: LineTable, polls: Sequence[Poll], is_kept: IsKept) -> list[str]:
    """Return the next rate that helps, and how many starters are too many."""
    timing = timing_of(line)
    found = []
    allowed = [
        set(setup.profile.bauds) for setup in setups_of(line) if setup.is_enabled and setup.profile.bauds
    ]
    for baud in sorted(each for each in get_args(Baud) if each > line.baud):
        is_allowed = all(baud in bauds for bauds in allowed)
        if is_allowed and is_kept(polls, LineTiming(baud, timing.framing)):
            found.append(f"baud = {baud}")
            break
    units = list(dict.fromkeys(poll.unit for poll in polls))
    stay = _most(len(units), lambda count: is_kept([p for p in polls if p.unit in units[:count]], timing))
    if stay:
        found.append(f"{len(units) - stay} of its {len(units)} starters on another line")
    return found


def _keeps_watchdogs(polls: Sequence[Poll], timing: LineTiming, *, allowance_s: float) -> bool:
    return not missed_deadlines(polls, timing, allowance_s=allowance_s)


def _keeps_periods(polls: Sequence[Poll], timing: LineTiming) -> bool:
    return not forecast(polls, timing).is_overloaded


def _with_watchdogs(polls: Sequence[Poll], least_s: float) -> list[Poll]:
    return with_deadlines(
        polls, {poll.unit: max(poll.deadline_s, least_s) for poll in polls if poll.deadline_s}
    )


def _most(count: int, is_kept: Callable[[int], bool]) -> int:
    """Return the largest number below `count` for which it is kept; 0 when it is for none."""
    low, high = 0, count
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if is_kept(middle) else (low, middle)
    return low


def _least(is_kept: Callable[[float], bool], *, most: int = LONGEST_LIMIT_S) -> float | None:
    """Return the least whole number up to `most` for which it is kept; None when it is for none."""
    low, high = 0, most
    if not is_kept(high):
        return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if is_kept(middle) else (middle, high)
    return float(high)


@dataclass(frozen=True, slots=True)
class FastGain:
    """One starter's status and values, read as they stand in the starter and by mapped words."""

    starter: str
    requests: tuple[int, int]  # before and after
    sweep_s: tuple[float, float]  # to ask for all of them once


def fast_gains(line: LineTable) -> tuple[FastGain, ...]:
    """Return what the starters of a line with `fast_words` gain by them."""
    gains = []
    for setup in setups_of(line):
        if setup.has_fast_words and setup.is_enabled:
            before, after = _often(polls_of(setup)), _often(fast_polls_of(setup))
            sweeps_s = _sweep_s(line, before), _sweep_s(line, after)
            gains.append(FastGain(setup.name, (len(before), len(after)), sweeps_s))
    return tuple(gains)


def fast_lines(line: LineTable) -> tuple[str, ...]:
    """Return the same in words, a line for each starter."""
    return tuple(
        f"  fast words: {gain.starter}'s status and values take {gain.requests[1]} of {gain.requests[0]}"
        f" requests, {gain.sweep_s[1]:.3f} s of {gain.sweep_s[0]:.3f} s (once they are mapped)"
        for gain in fast_gains(line)
    )


def _often(polls: Sequence[Poll]) -> list[Poll]:
    return [poll for poll in polls if poll.group != "slow"]


def _sweep_s(line: LineTable, polls: Sequence[Poll]) -> float:
    return forecast(polls, timing_of(line), allowance_s=line.adapter_allowance_s).sweep_s
