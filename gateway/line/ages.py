"""How old values get at the worst, when the earliest deadline is served first and periods are stretched."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from gateway.line.demand import Demand
from gateway.line.stretch import FREE_ROOM, stretch_of

_LEAST_LEFT = 0.05


class Asked(NamedTuple):
    """One poll in numbers."""

    every_s: float  # 0: as often as the line allows
    cost_s: float  # of the line's time at most
    least_s: float  # at least


def ages_s(asked: Sequence[Asked], urgent: Sequence[tuple[float, float]]) -> list[float]:
    """Return the longest time between two answers of each; `urgent` (cost, period) come before all of them.

    The first of the two answers came at once; then the other requests come first, by their rhythm or all at
    once out of it, as far as their deadlines are earlier.
    """
    free_s = [each.cost_s for each in asked if not each.every_s]
    timed = [(each.cost_s, each.every_s) for each in asked if each.every_s]
    load = sum(cost_s / every_s for cost_s, every_s in timed)
    others = sum(cost_s / period_s for cost_s, period_s in urgent)
    factor = stretch_of(load, others=others, has_free=bool(free_s))
    slower = 1.0 - FREE_ROOM if free_s else 1.0  # those without a period have their share
    demand = Demand([*((cost_s / slower, every_s * factor) for cost_s, every_s in timed), *urgent])
    urgent_s = sum(cost_s for cost_s, _ in urgent)  # these may come once more at any time
    longest_s = max((each.cost_s for each in asked), default=0.0)
    longest_free_s, all_free_s = max(free_s, default=0.0), sum(free_s)
    behind_s = _longest_behind(timed, longest_free_s)
    round_s = _round_s(timed, free_s, load=demand.load, others=others) + urgent_s
    busy_s = demand.busy_s(longest_s + longest_free_s + all_free_s)
    ages = []
    for each in asked:
        if not each.every_s:
            ages.append(round_s)
            continue
        period_s = each.every_s * factor
        quiet_s = behind_s[each.every_s] + longest_free_s + demand.response_s(period_s)
        storm_s = longest_s + longest_free_s + demand.storm_s(period_s) + all_free_s
        waits_s = min(max(quiet_s, storm_s), busy_s) + urgent_s
        ages.append(period_s + waits_s - each.least_s)
    return ages


def _round_s(
    timed: Sequence[tuple[float, float]], free_s: Sequence[float], *, load: float, others: float
) -> float:
    """Return the longest round of the polls without a period: what the others leave, their share at least."""
    timed_s = sum(cost_s for cost_s, _ in timed)
    by_load_s = 2 * (sum(free_s) + timed_s) / max(1.0 - load, _LEAST_LEFT)
    longest_s = max([*free_s, *(cost_s for cost_s, _ in timed)], default=0.0)
    by_share_s = (sum(free_s) + max(free_s, default=0.0)) / FREE_ROOM + (len(free_s) + 1) * longest_s
    return min(by_load_s, by_share_s / max(1.0 - others, _LEAST_LEFT))


def _longest_behind(timed: Sequence[tuple[float, float]], free_s: float) -> dict[float, float]:
    """Return by period the longest request of a longer one, which may just have begun."""
    found_s: dict[float, float] = {}
    longest_s = equal_s = free_s
    for cost_s, every_s in sorted(timed, key=lambda each: -each[1]):
        if every_s not in found_s:
            longest_s = max(longest_s, equal_s)
            found_s[every_s] = longest_s
        equal_s = max(equal_s, cost_s)
    return found_s
