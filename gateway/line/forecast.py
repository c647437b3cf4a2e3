"""What a line's polls add up to, from numbers alone: how busy it will be, and how old its values get.

`Plan` asks the poll that has waited longest and keeps at most one instance of each waiting; the bounds here
follow from that. They hold while the units answer, and while no commands are under way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

from gateway.line.budget import ALLOWANCE_S, reply_within_s, request_wire_s, worst_stop_latency_s
from gateway.line.job import Poll
from gateway.modbus.timing import LineTiming


@dataclass(frozen=True, slots=True)
class PollForecast:
    """One poll's share of a line."""

    poll: Poll
    cost_s: float  # of the line's time, silence included, when the unit takes as long as it may
    period_s: float  # between two answers, about; longer than the poll's own when the line is too slow
    age_s: float  # the oldest that its values get before newer ones come


@dataclass(frozen=True, slots=True)
class Forecast:
    """A whole line."""

    load: float  # share of the line's time that the polls with a period ask for; above 1 they are stretched
    sweep_s: float  # to ask everything once
    stop_latency_s: float  # from a stop's submission to its first byte, at the worst
    polls: tuple[PollForecast, ...]

    @property
    def is_overloaded(self) -> bool:
        """Return whether the line cannot keep every period."""
        return self.load > 1.0


def forecast(polls: Sequence[Poll], timing: LineTiming, *, allowance_s: float = ALLOWANCE_S) -> Forecast:
    """Return what these polls ask of a line; a poll with `every_s` 0 takes what time the others leave."""
    costs_s = [_cost_s(poll, timing, allowance_s=0.0) for poll in polls]
    turn_s = _turn_s([(cost_s, poll.every_s) for cost_s, poll in zip(costs_s, polls, strict=True)])
    late_sweep_s = sum(_cost_s(poll, timing, allowance_s=allowance_s) for poll in polls)
    return Forecast(
        load=sum(cost_s / poll.every_s for cost_s, poll in zip(costs_s, polls, strict=True) if poll.every_s),
        sweep_s=sum(costs_s),
        stop_latency_s=worst_stop_latency_s(polls, timing, allowance_s=allowance_s),
        polls=tuple(
            # No other poll comes twice before one that is due: it would be due later itself.
            PollForecast(poll, cost_s, max(poll.every_s, turn_s), poll.every_s + late_sweep_s)
            for cost_s, poll in zip(costs_s, polls, strict=True)
        ),
    )


def longest_gap_s(prospect: Forecast, unit: int) -> float:
    """Return the longest time between two requests to a unit; infinite when it is never asked."""
    return min((each.age_s for each in prospect.polls if each.poll.unit == unit), default=inf)


def _cost_s(poll: Poll, timing: LineTiming, *, allowance_s: float) -> float:
    within_s = reply_within_s(
        poll.request, timing, response_time_s=poll.response_time_s, allowance_s=allowance_s
    )
    return timing.silence_s + request_wire_s(poll.request, timing) + within_s


def _turn_s(polls: list[tuple[float, float]]) -> float:
    """Return the period of the polls (cost, period) that wait for their turn; 0 when all are kept in time.

    Polls of a longer period keep it; the others share what is left of the line evenly.
    """
    shared_s = 0.0
    kept = sum(cost_s / every_s for cost_s, every_s in polls if every_s)
    if kept <= 1.0 and all(every_s for _, every_s in polls):
        return 0.0
    for cost_s, every_s in sorted(polls, key=lambda poll: poll[1]):
        if shared_s and kept < 1.0 and shared_s / (1.0 - kept) <= every_s:
            break
        shared_s += cost_s
        kept -= cost_s / every_s if every_s else 0.0
    return shared_s / (1.0 - kept)
