"""How soon starters answer, for the statistics.

The response times of each unit and function are counted in classes of 5 %, old ones at half their weight from
time to time, so that the memory is bounded and follows a starter that changes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import ceil, log

_CLASS = log(1.05)
_SHORTEST_S = 0.0001  # what is shorter counts as this
_FORGET_FROM = 4096  # answers, then each counts half

Quantiles = dict[str, float | None]


@dataclass(slots=True)
class _Class:
    """The answers whose times lie within 5 %."""

    count: int = 0
    sum_s: float = 0.0


class ResponseTimes:
    """A running distribution of response times."""

    def __init__(self) -> None:
        self._classes: dict[int, _Class] = {}
        self._total = 0

    @property
    def classes(self) -> Iterable[tuple[int, int, float]]:
        """What was counted: class, answers in it, the sum of their times."""
        return ((at, each.count, each.sum_s) for at, each in self._classes.items())

    def note(self, response_time_s: float) -> None:
        """Count one answer."""
        at = int(log(max(response_time_s, _SHORTEST_S)) / _CLASS)
        each = self._classes.get(at)
        if each is None:
            each = self._classes[at] = _Class()
        each.count += 1
        each.sum_s += response_time_s
        self._total += 1
        if self._total >= _FORGET_FROM:
            self._forget()

    def _forget(self) -> None:
        left = {
            at: _Class(each.count // 2, each.sum_s / each.count * (each.count // 2))
            for at, each in self._classes.items()
            if each.count > 1
        }
        self._classes = left
        self._total = sum(each.count for each in left.values())


def quantile_s(distributions: Iterable[ResponseTimes], share: float) -> float | None:
    """Return the time within which this share of all answers came, to about 5 %; None of nothing."""
    return _quantiles(distributions, {"": share})[""]


def _quantiles(distributions: Iterable[ResponseTimes], shares: Mapping[str, float]) -> Quantiles:
    """Return the times within which these shares of all answers came; the least share first."""
    joined = sorted(each for times in distributions for each in times.classes)
    total = sum(count for _, count, _ in joined)
    found: Quantiles = dict.fromkeys(shares)
    wanted = [(max(ceil(share * total), 1), name) for name, share in shares.items()]
    passed = 0
    for _, count, sum_s in joined:
        passed += count
        while wanted and wanted[0][0] <= passed:
            found[wanted.pop(0)[1]] = sum_s / count
    return found


class UnitResponseTimes:
    """The response times of a line's units, by unit and function."""

    def __init__(self) -> None:
        self._times: dict[int, dict[int, ResponseTimes]] = {}

    def note_answer(self, unit: int, function: int, response_time_s: float) -> None:
        """Count an answer of a unit."""
        functions = self._times.setdefault(unit, {})
        times = functions.get(function)
        if times is None:
            times = functions[function] = ResponseTimes()
        times.note(response_time_s)

    def forget(self, unit: int) -> None:
        """Know nothing of a unit any more."""
        self._times.pop(unit, None)

    def quantiles(self, unit: int) -> Quantiles:
        """Return p50 and p99 of a unit's response times, all functions together; None of nothing."""
        return _quantiles(self._times.get(unit, {}).values(), {"p50": 0.50, "p99": 0.99})

    def functions(self, unit: int) -> dict[int, Quantiles]:
        """Return p50, p99 and p99.9 of a unit by function."""
        shares = {"p50": 0.50, "p99": 0.99, "p999": 0.999}
        return {
            int(function): _quantiles((times,), shares)
            for function, times in self._times.get(unit, {}).items()
        }
