"""What a line's polls add up to, from numbers alone: how busy it will be, and how old its values get.

The bounds follow from how `Plan` chooses. They hold while the units answer and no commands are under way,
with every reply as late as the line waits for it, and also when all polls but one are asked for at the same
moment out of their rhythm, as after a voltage dip that trips every motor; from the first round after the
port was opened on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

from gateway.line.capacity.demand import Demand
from gateway.line.capacity.value_age import Asked, ages_s
from gateway.line.rtu.timeouts import ALLOWANCE_S, longest_s, reply_within_s, request_wire_s
from gateway.line.scheduler.load import room_of, stretch_of
from gateway.line.scheduler.requests import Poll
from gateway.line.scheduler.scheduler import WATCHDOGS_IN_ROW
from gateway.line.scheduler.stop_latency import worst_stop_latency_s
from gateway.line.scheduler.watchdogs import KEPT_SHARE
from gateway.modbus.timing import LineTiming


@dataclass(frozen=True, slots=True)
class PollForecast:
    """One poll's share of a line."""

    poll: Poll
    cost_s: float  # of the line's time, silence included, when the unit takes as long as it may
    period_s: float  # between two answers, on average; longer than the poll's own when the line is over-full
    age_s: float  # the oldest that its values get before newer ones come


@dataclass(frozen=True, slots=True)
class Forecast:
    """A whole line."""

    load: float  # share of the line's time that the polls with a period ask for; above 1 they are stretched
    sweep_s: float  # to ask everything once
    stop_latency_s: float  # from a stop's submission to its first byte, at the worst
    polls: tuple[PollForecast, ...]
    watchdog_load: float  # share of the line's time that the watchdogs need which the polls alone do not keep
    watchdog_gaps_s: Mapping[int, float]  # by unit with a watchdog: the longest time that it hears nothing

    @property
    def is_overloaded(self) -> bool:
        """Return whether the line cannot keep every period."""
        return self.load > 1.0


def forecast(polls: Sequence[Poll], timing: LineTiming, *, allowance_s: float = ALLOWANCE_S) -> Forecast:
    """Return what these polls ask of a line; a poll with `every_s` 0 takes what time the others leave."""
    costs_s = [_cost_s(poll, timing, allowance_s=0.0) for poll in polls]
    asked = [
        Asked(
            poll.every_s,
            _cost_s(poll, timing, allowance_s=allowance_s),
            _cost_s(replace(poll, response_time_s=0.0), timing, allowance_s=0.0),
        )
        for poll in polls
    ]
    longest = max((_silent_s(poll, timing, allowance_s=allowance_s) for poll in polls), default=0.0)
    worst_s, dogs = _worst(polls, asked)
    watchdog_load, kept_s = _kept({unit: (asked[at].cost_s, s) for unit, (at, s) in dogs.items()}, longest)
    freshest_s = _freshest_s(polls, worst_s)
    gaps_s = {unit: min(freshest_s[unit], kept_s.get(unit, inf)) for unit in _dogs(polls)}
    return Forecast(
        load=sum(cost_s / poll.every_s for cost_s, poll in zip(costs_s, polls, strict=True) if poll.every_s),
        sweep_s=sum(costs_s),
        stop_latency_s=worst_stop_latency_s(polls, timing, allowance_s=allowance_s),
        polls=tuple(map(PollForecast, polls, costs_s, _periods_s(polls, costs_s), worst_s)),
        watchdog_load=watchdog_load,
        watchdog_gaps_s=gaps_s,
    )


def longest_gap_s(prospect: Forecast, unit: int) -> float:
    """Return the longest time between two requests to a unit; infinite when it is never asked."""
    asked_s = min((each.age_s for each in prospect.polls if each.poll.unit == unit), default=inf)
    return prospect.watchdog_gaps_s.get(unit, asked_s)


def _periods_s(polls: Sequence[Poll], costs_s: Sequence[float]) -> list[float]:
    """Return the average period of every poll, those asked for a watchdog's sake included."""
    periods_s = [poll.every_s for poll in polls]
    kept_s: dict[int, float] = {}  # by position
    while True:
        free_s = sum(cost_s for cost_s, poll in zip(costs_s, polls, strict=True) if not poll.every_s)
        others = sum(costs_s[at] / period_s for at, period_s in kept_s.items())
        room = room_of(others=others, has_free=free_s > 0)
        timed = [at for at, poll in enumerate(polls) if poll.every_s and at not in kept_s]
        load = sum(costs_s[at] / polls[at].every_s for at in timed)
        factor = max(1.0, load / room)  # without slack, which is not left idle
        if free_s:
            factor = stretch_of(load, others=others, has_free=True)
        left = max(1.0 - others - load / factor, 1.0 - room)
        for at, poll in enumerate(polls):
            period_s = poll.every_s * factor if poll.every_s else free_s / left
            periods_s[at] = kept_s.get(at, period_s)
        fastest_s = _freshest_s(polls, periods_s)
        more = {
            at: s
            for unit, (at, s) in _dogs(polls).items()
            if at not in kept_s and s < fastest_s[unit]  # any of its polls keeps a watchdog
        }
        if not more:
            return periods_s
        kept_s |= more


def _dogs(polls: Sequence[Poll]) -> dict[int, tuple[int, float]]:
    """Return by unit with a watchdog the position of its first poll, and how often that is asked for it."""
    firsts: dict[int, int] = {}
    limits_s: dict[int, float] = {}
    for at, poll in enumerate(polls):
        firsts.setdefault(poll.unit, at)
        if poll.deadline_s:
            limits_s[poll.unit] = poll.deadline_s
    return {unit: (firsts[unit], KEPT_SHARE * limit_s) for unit, limit_s in limits_s.items()}


def _freshest_s(polls: Sequence[Poll], worst_s: Sequence[float]) -> dict[int, float]:
    """Return by unit the age, or the period, of what is read most often."""
    found_s: dict[int, float] = {}
    for poll, age_s in zip(polls, worst_s, strict=True):
        found_s[poll.unit] = min(age_s, found_s.get(poll.unit, inf))
    return found_s


def _worst(polls: Sequence[Poll], asked: Sequence[Asked]) -> tuple[list[float], dict[int, tuple[int, float]]]:
    """Return every poll's age, and the units whose watchdogs need more than the polls, as `_dogs` does.

    The more units need that, the less is left to the others: so again until no more of them do.
    """
    dogs: dict[int, tuple[int, float]] = {}
    while True:
        worst_s = ages_s(asked, [(asked[at].cost_s, period_s) for at, period_s in dogs.values()])
        freshest_s = _freshest_s(polls, worst_s)
        more = {
            unit: dog for unit, dog in _dogs(polls).items() if unit not in dogs and dog[1] < freshest_s[unit]
        }
        if not more:
            return worst_s, dogs
        dogs |= more


def _kept(dogs: Mapping[int, tuple[float, float]], other_s: float) -> tuple[float, dict[int, float]]:
    """Return the load of these watchdogs (cost, period), and the longest time that each unit hears nothing.

    Each waits for the others, and for whatever was under way and has a turn after so many of them in a row.
    """
    extra_s = other_s / WATCHDOGS_IN_ROW
    demand = Demand((cost_s + extra_s, period_s) for cost_s, period_s in dogs.values())
    kept_s = {unit: s + other_s + demand.response_s(s) for unit, (_, s) in dogs.items()}
    return demand.load, kept_s


def _cost_s(poll: Poll, timing: LineTiming, *, allowance_s: float) -> float:
    within_s = reply_within_s(
        poll.request, timing, response_time_s=poll.response_time_s, allowance_s=allowance_s
    )
    return timing.silence_s + request_wire_s(poll.request, timing) + within_s


def _silent_s(poll: Poll, timing: LineTiming, *, allowance_s: float) -> float:
    response_time_s = poll.response_time_s
    return timing.silence_s + longest_s(
        poll.request, timing, response_time_s=response_time_s, allowance_s=allowance_s
    )
