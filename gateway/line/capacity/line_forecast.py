"""The sum of a line's polls, from numbers alone.

Promised, with any number of commands under way: the load, the sweep, the longest wait of a stop, and the
longest time that a unit with a watchdog is left (`Forecast.watchdog_gaps_s`). The bounds follow from how
`Scheduler` chooses. A watchdog is met when that time is not longer than its own: the one rule for `check`,
`set` and reload. The bounds hold from the second round after the port was opened on, while the units answer,
with every reply as late as the line waits for it.
Stops come on top: each adds its own transaction, and its repeats and read-backs as many as there are
requests for watchdogs.

`Forecast.gaps_s` are estimates: a line without commands, on which everything else goes first once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, inf

from gateway.line.capacity.demand import Demand
from gateway.line.rtu.transaction import ALLOWANCE_S, longest_s, reply_within_s, request_wire_s
from gateway.line.scheduler.line_time import (
    FREE_PERIOD_S,
    JOBS_BURST_S,
    JOBS_SHARE,
    overload_factor,
)
from gateway.line.scheduler.polls import ASKED_AFTER
from gateway.line.scheduler.requests import Poll
from gateway.line.scheduler.scheduler import IN_ROW
from gateway.modbus import LineTiming

LONGEST_LIMIT_S = 1000  # beyond what any family's watchdog can be set to (P314, C8.2.5.3, R41: 999 s)
_ENDLESS_S = 3600.0  # a wait that is longer has no end


@dataclass(frozen=True, slots=True)
class Missed:
    """A watchdog that would act although everything works."""

    unit: int
    limit_s: float
    gap_s: float  # infinite when the watchdogs together need more time than there is
    load: float  # share of the line's time that the watchdogs need


@dataclass(frozen=True, slots=True)
class Forecast:
    """A whole line."""

    load: float  # share of the line's time that the polls with a period ask for; above 1 they are stretched
    sweep_s: float  # to ask everything once
    stop_latency_s: float  # from a stop's submission to its first byte, at the worst
    factor: float  # by which all periods are stretched on a line without commands
    watchdog_load: float  # share of the line's time that the watchdogs need when no poll helps them
    watchdog_gaps_s: Mapping[int, float]  # by unit with a watchdog: the longest time between two requests
    missed: tuple[Missed, ...]  # the watchdogs whose time is shorter than that
    gaps_s: Mapping[int, float]  # by unit: an estimate of the same without commands

    @property
    def is_overloaded(self) -> bool:
        """Return whether the line cannot keep every period."""
        return self.load > 1.0


def forecast(
    polls: Sequence[Poll], timing: LineTiming, *, allowance_s: float = ALLOWANCE_S, jobs: Sequence[Poll] = ()
) -> Forecast:
    """Return what these polls ask of a line.

    No command's request takes longer than the longest of the polls and of what commands decide on. `jobs`
    may, and come once in a while: they count for the stop's latency only.
    """
    costs_s = [_cost_s(poll, timing, allowance_s=0.0) for poll in polls]
    late_s = [_cost_s(poll, timing, allowance_s=allowance_s) for poll in polls]
    longest = worst_stop_latency_s(polls, timing, allowance_s=allowance_s)
    factor = overload_factor(_load(polls, costs_s))
    # Watchdogs: the time within which the scheduler reaches each unit, also in a flood of commands.
    watchdogs = _watchdogs(polls, late_s)
    demand = Demand((cost_s + longest / IN_ROW, asked_s) for cost_s, asked_s in watchdogs.values())
    in_flood_s = _in_flood_s(polls, late_s, watchdogs.values(), longest)
    promised_s = {
        unit: min(asked_s + longest + demand.response_s(asked_s), in_flood_s[unit])
        for unit, (_, asked_s) in watchdogs.items()
    }
    # Polls with a period load the line; those without share what is left of it.
    load = sum(cost_s / poll.every_s for cost_s, poll in zip(costs_s, polls, strict=True) if poll.every_s)
    free_s = sum(cost_s for cost_s, poll in zip(costs_s, polls, strict=True) if not poll.every_s)
    round_s = min(free_s / (1.0 - load), FREE_PERIOD_S) if load < 1.0 else FREE_PERIOD_S
    gaps_s = dict(promised_s)
    for poll in polls:  # all others go first once
        gap_s = factor * (poll.every_s or round_s) + sum(late_s)
        gaps_s[poll.unit] = min(gap_s, gaps_s.get(poll.unit, inf))
    return Forecast(
        load=load,
        sweep_s=sum(costs_s),
        stop_latency_s=max(longest, worst_stop_latency_s(jobs, timing, allowance_s=allowance_s)),
        factor=factor,
        watchdog_load=demand.load,
        watchdog_gaps_s=promised_s,
        missed=tuple(
            Missed(unit, asked_s / ASKED_AFTER, promised_s[unit], demand.load)
            for unit, (_, asked_s) in watchdogs.items()
            if promised_s[unit] > asked_s / ASKED_AFTER
        ),
        gaps_s=gaps_s,
    )


def worst_stop_latency_s(
    polls: Iterable[Poll], timing: LineTiming, *, allowance_s: float = ALLOWANCE_S
) -> float:
    """Return the longest time from a stop's submission to its first byte while these requests are sent.

    It waits for the one transaction that is on the wire, in its longest form.
    """
    forms = {  # most starters of a line are asked alike
        (request, poll.response_time_s)
        for poll in polls
        for request in (
            poll.request,
            *(other for other, _ in poll.forms.alternates_of(poll.request)),
            *poll.forms.decisions,
        )
    }
    waits_s = (
        longest_s(request, timing, response_time_s=response_time_s, allowance_s=allowance_s)
        for request, response_time_s in forms
    )
    return max(waits_s, default=0.0) + timing.silence_s


def least_whole(holds: Callable[[float], bool]) -> float | None:
    """Return the shortest watchdog in whole seconds from which on it holds; None when it holds for none."""
    low, high = 0, LONGEST_LIMIT_S
    if not holds(high):
        return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return float(high)


def _watchdogs(polls: Sequence[Poll], costs_s: Sequence[float]) -> dict[int, tuple[float, float]]:
    """Return by unit with a watchdog what its first poll costs, and how often that is asked for it."""
    firsts_s: dict[int, float] = {}
    limits_s: dict[int, float] = {}
    for poll, cost_s in zip(polls, costs_s, strict=True):
        firsts_s.setdefault(poll.unit, cost_s)
        if poll.deadline_s:
            limits_s[poll.unit] = poll.deadline_s
    return {unit: (firsts_s[unit], ASKED_AFTER * limit_s) for unit, limit_s in limits_s.items()}


def _in_flood_s(
    polls: Sequence[Poll], costs_s: Sequence[float], watchdogs: Iterable[tuple[float, float]], longest: float
) -> dict[int, float]:
    """Return by unit the longest time between two requests by its fastest poll while jobs take all they may.

    A poll waits for the request on the wire, what jobs have saved up and get meanwhile, the watchdogs that
    become due meanwhile, and everything else once.
    """
    factor = overload_factor(_load(polls, costs_s), others=JOBS_SHARE)
    urgent = list(watchdogs)
    once_s = 2 * longest + JOBS_BURST_S + sum(costs_s) + sum(cost_s for cost_s, _ in urgent)
    wait_s = _lasts_s(once_s, urgent, share=JOBS_SHARE)
    gaps_s: dict[int, float] = {}
    for poll in polls:
        gap_s = (poll.every_s or FREE_PERIOD_S) * factor + wait_s
        gaps_s[poll.unit] = min(gap_s, gaps_s.get(poll.unit, inf))
    return gaps_s


def _lasts_s(once_s: float, asked: Sequence[tuple[float, float]], *, share: float) -> float:
    """Return how long work lasts while requests (cost, period) and a share of the time go first."""
    time_s = 0.0
    while time_s < _ENDLESS_S:
        longer_s = (
            once_s + share * time_s + sum(cost_s * ceil(time_s / period_s) for cost_s, period_s in asked)
        )
        if longer_s - time_s < 1e-6:
            return time_s
        time_s = longer_s
    return inf


def _load(polls: Sequence[Poll], costs_s: Sequence[float]) -> float:
    return sum(cost_s / (poll.every_s or FREE_PERIOD_S) for poll, cost_s in zip(polls, costs_s, strict=True))


def _cost_s(poll: Poll, timing: LineTiming, *, allowance_s: float) -> float:
    within_s = reply_within_s(
        poll.request, timing, response_time_s=poll.response_time_s, allowance_s=allowance_s
    )
    return timing.silence_s + request_wire_s(poll.request, timing) + within_s
