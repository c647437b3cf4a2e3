"""How old values get at the worst, from numbers alone; the bounds follow from how `Rota` and `Polled` choose.

A poll that has become due waits for the request under way and for others:

- On a busy line polls go by due time. So each of the others goes first once at most, whenever and
  however often it is hastened: it is behind those that were due before.
- Otherwise they go by deadline, a period after they are due. Those of the same period go first once; those of
  shorter ones as often as they come in that time, and once more when all are hastened meanwhile; those of
  longer ones only if they may have waited for longer than the periods differ.

A poll without a period waits for its equals once, and until no other is due, or it has its share.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from math import ceil, floor, inf
from typing import NamedTuple

from gateway.line.scheduler.load import BUSY, EASED, FREE_ROOM, fullness_of

_ROUNDS = 1000  # towards the length of a wait; what takes more has no end
_SAME_S = 1e-9
_INTERVALS = 32  # of the time in which all may be asked for at once


class Asked(NamedTuple):
    """One poll in numbers."""

    every_s: float  # 0: as often as the line allows
    cost_s: float  # of the line's time at most
    least_s: float  # at least


Urgent = Sequence[tuple[float, float]]  # cost and period


def ages_s(asked: Sequence[Asked], urgent: Urgent) -> list[float]:
    """Return the longest time between two answers of each; `urgent` come before all of them.

    The first of the two answers came at once, and as soon as it can.
    """
    others = sum(cost_s / period_s for cost_s, period_s in urgent)
    if others >= 1.0:
        return [inf] * len(asked)
    load = sum(each.cost_s / each.every_s for each in asked if each.every_s)
    fullness = fullness_of(load, others=others, has_free=any(not each.every_s for each in asked))
    # A busy line on which all take less time than they may is one with time to spare.
    spared = _Line(asked, urgent, scale=min(1.0, BUSY / fullness) if fullness else 1.0)
    oldest_s = {every_s: every_s + wait_s for every_s, wait_s in spared.waits_by_deadline_s().items()}
    stretch = max(1.0, fullness)
    line = _Line(asked, urgent, stretch=stretch)
    if fullness > EASED:
        wait_s = line.wait_by_due_time_s()
        oldest_s = {every_s: max(s, every_s * stretch + wait_s) for every_s, s in oldest_s.items()}
    round_s = line.round_s()
    return [
        (oldest_s[each.every_s] if each.every_s else round_s + each.cost_s) - each.least_s for each in asked
    ]


class _Line:
    """The polls of a line by period; their costs may be scaled, their periods stretched."""

    def __init__(
        self, asked: Sequence[Asked], urgent: Urgent, *, scale: float = 1.0, stretch: float = 1.0
    ) -> None:
        sums_s: defaultdict[float, float] = defaultdict(float)
        for each in asked:
            if each.every_s:
                sums_s[each.every_s * stretch] += each.cost_s * scale
        self._sums_s = dict(sorted(sums_s.items()))
        self._urgent = urgent
        self._free_s = [each.cost_s * scale for each in asked if not each.every_s]
        self._longest_s = max((each.cost_s * scale for each in asked), default=0.0)

    def wait_by_due_time_s(self) -> float:
        """Return how long a poll waits until it is answered where polls go by due time."""
        return self._timed_end_s(lambda _: self._longest_s + sum(self._sums_s.values()))

    def waits_by_deadline_s(self) -> dict[float, float]:
        """Return how long polls wait until they are answered, by period, where they go by deadline."""
        at_most_s = self._waits_s(dict.fromkeys(self._sums_s, inf))
        return self._waits_s(at_most_s)

    def round_s(self) -> float:
        """Return how long a poll without a period waits: for its equals, and for as many others as may come.

        The others have the line until the share of those without a period is due again.
        """
        longest_s = max([self._longest_s, *(cost_s for cost_s, _ in self._urgent)])
        by_load_s = self._stormy_end_s(longest_s + sum(self._free_s))
        by_share_s = self._end_s(lambda _: sum(cost_s / FREE_ROOM + longest_s for cost_s in self._free_s))
        return min(by_load_s, by_share_s)

    def _stormy_end_s(self, once_s: float) -> float:
        """Return when nothing with a period is due any more, all being due at first and asked for once more.

        What still waits then is not asked for twice, so of each period no more comes again than what can have
        been served since it was due; and from then on its periods begin anew.
        """
        calm_s = self._end_s(lambda wait_s: once_s + self._due_s(wait_s))
        if calm_s == inf or not self._sums_s:
            return calm_s
        ends_s = {calm_s * number / _INTERVALS for number in range(_INTERVALS + 1)}
        for every_s in self._sums_s:
            ends_s |= {every_s * number for number in range(min(ceil(calm_s / every_s), _INTERVALS))}
        return max(self._asked_again_end_s(once_s, *span) for span in pairwise(sorted(ends_s)))

    def _asked_again_end_s(self, once_s: float, from_s: float, to_s: float) -> float:
        """Return the same when all are asked for once more at some time between these two."""
        before_s = again_s = 0.0
        for every_s, cost_s in self._sums_s.items():
            times = ceil(to_s / every_s - _SAME_S)  # that it was due by then
            before_s += times * cost_s
            again_s += min(cost_s, to_s - (times - 1) * every_s if (times - 1) * every_s <= from_s else inf)
        first_s = once_s + before_s + min(again_s, to_s) - sum(self._sums_s.values())
        return self._end_s(lambda wait_s: first_s + self._due_s(wait_s - from_s))

    def _due_s(self, within_s: float) -> float:
        """Return what the polls that are due within some time cost, those that are due at its begin too."""
        return sum(
            cost_s * (1 + floor(max(within_s, 0.0) / every_s + _SAME_S))
            for every_s, cost_s in self._sums_s.items()
        )

    def _waits_s(self, at_most_s: Mapping[float, float]) -> dict[float, float]:
        """Return the waits by period when none is longer than these."""
        waits_s: dict[float, float] = {}
        for every_s, own_s in self._sums_s.items():
            late_s = sum(
                cost_s
                for other_s, cost_s in self._sums_s.items()
                if every_s < other_s < every_s + at_most_s[other_s]
            )
            once_s = self._longest_s + own_s + late_s
            shorter = [other_s for other_s in self._sums_s if other_s < every_s]
            waits_s[every_s] = self._timed_end_s(partial(self._ahead_s, once_s, shorter, every_s))
        return waits_s

    def _ahead_s(self, once_s: float, others: Iterable[float], deadline_s: float, wait_s: float) -> float:
        """Return what goes first once, with all that comes of these periods while one waits.

        What is due too late for the deadline comes behind; and all of it is asked for once more.
        """
        return once_s + sum(
            self._sums_s[every_s] * (1 + min(1 + floor(wait_s / every_s + _SAME_S), deadline_s / every_s))
            for every_s in others
        )

    def _timed_end_s(self, ahead_s: Callable[[float], float]) -> float:
        """Return when what is ahead is done, while polls without a period take their share."""
        if not self._free_s:
            return self._end_s(ahead_s)
        return self._end_s(lambda wait_s: (ahead_s(wait_s) + max(self._free_s)) / (1.0 - FREE_ROOM))

    def _end_s(self, ahead_s: Callable[[float], float]) -> float:
        """Return when what is ahead by then is done, and what is urgent besides; infinite for never."""
        wait_s = 0.0
        for _ in range(_ROUNDS):
            longer_s = ahead_s(wait_s) + sum(
                cost_s * (1 + floor(wait_s / period_s)) for cost_s, period_s in self._urgent
            )
            if longer_s <= wait_s:
                return wait_s
            wait_s = longer_s
        return inf
