"""How long repeated requests wait for one another when the earliest deadline is served first."""

from __future__ import annotations

import heapq
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterable, Iterator
from math import inf

_POINTS = 4000  # of the demand are looked at; beyond them its straight upper bound counts
_SAME_S = 1e-9


class Demand:
    """The demand of requests (cost, period) on a line, each due a period after the one before at the soonest.

    Each has its period as deadline. In a window of length x at most x // period of each both come and
    must be done; what is asked beyond x is what the last of them waits for (processor demand, Baruah 1990).
    """

    def __init__(self, asked: Iterable[tuple[float, float]]) -> None:
        costs_s: defaultdict[float, float] = defaultdict(float)
        for cost_s, period_s in asked:
            costs_s[period_s] += cost_s
        self.load = sum(cost_s / period_s for period_s, cost_s in costs_s.items())
        self._ends_s: list[float] = []
        self._excesses_s: list[float] = []
        for end_s, demand_s in _steps(costs_s, limit=_POINTS):
            self._ends_s.append(end_s)
            self._excesses_s.append(demand_s - end_s)
        worst_s = -(1.0 - self.load) * self._ends_s[-1] if self._ends_s else 0.0
        for at in range(len(self._excesses_s) - 1, -1, -1):
            worst_s = self._excesses_s[at] = max(worst_s, self._excesses_s[at])

    def response_s(self, period_s: float) -> float:
        """Return how long after its due time a request of this period is done; inf on an over-full line."""
        if self.load > 1.0:
            return inf
        at = bisect_left(self._ends_s, period_s - _SAME_S)
        if at < len(self._excesses_s):
            return period_s + self._excesses_s[at]
        return period_s * self.load


def _steps(costs_s: dict[float, float], *, limit: int) -> Iterator[tuple[float, float]]:
    """Return the windows at whose end more must be done, with how much that is in all."""
    ends = [(period_s, 1, period_s) for period_s in costs_s]
    heapq.heapify(ends)
    demand_s = 0.0
    for _ in range(limit):
        if not ends:
            return
        end_s = ends[0][0]
        # All requests whose deadline ends here; each comes again a period later.
        while ends[0][0] <= end_s + _SAME_S:
            _, count, period_s = ends[0]
            demand_s += costs_s[period_s]
            heapq.heapreplace(ends, ((count + 1) * period_s, count + 1, period_s))
        yield end_s, demand_s
