"""The overload factor: all periods grow by it together when the line is asked for more than it can do."""

from __future__ import annotations

from collections.abc import Iterable

from gateway.line.scheduler.job_queue import JOBS_SHARE
from gateway.line.scheduler.units import ScheduledPoll

FREE_PERIOD_S = 5.0  # the period of a poll with `every_s` 0; it comes earlier whenever the line is free

_AVERAGED_OVER_S = (
    10.0  # about so long back goes the share of jobs and offline units; costs are summed as often
)


def period_of(every_s: float) -> float:
    """Return the period of a poll that asks for `every_s`."""
    return every_s or FREE_PERIOD_S


def overload_factor(load: float, *, others: float = 0.0) -> float:
    """Return the factor for a load, when others take their share first, half of the line's time at most."""
    return max(1.0, load / (1.0 - min(others, JOBS_SHARE)))


class LoadControl:
    """The present factor, from what the polls have cost and what others have taken."""

    def __init__(self) -> None:
        self.factor = 1.0
        self._load = 0.0
        self._others = 0.0
        self._at_s: float | None = None
        self._summed_s: float | None = None  # None: something has changed

    def change(self) -> None:
        """Note that polls or periods have changed."""
        self._summed_s = None

    def update(self, polls: Iterable[ScheduledPoll], *, others_s: float, now_s: float) -> None:
        """Note that time has passed, of which jobs and offline units took `others_s`."""
        if self._at_s is not None and now_s > self._at_s:
            passed_s = now_s - self._at_s
            weight = min(passed_s / _AVERAGED_OVER_S, 1.0)
            self._others += weight * (min(others_s / passed_s, 1.0) - self._others)
        self._at_s = now_s
        if self._summed_s is None or now_s - self._summed_s >= _AVERAGED_OVER_S:
            self._summed_s = now_s
            self._load = sum(
                each.cost_s / period_of(each.every_s) for each in polls if not each.unit.is_silent
            )
        self.factor = overload_factor(self._load, others=self._others)
