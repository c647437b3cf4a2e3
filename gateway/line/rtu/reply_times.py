"""When a reply comes: how long it is waited for, and how soon it can begin.

How long follows from numbers alone. The response times of each unit and function are counted for the
statistics, in classes of 5 %, old ones at half their weight from time to time, so that the memory is bounded
and follows a starter that changes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import ceil, log

from gateway.modbus.adu import MAX_ADU_SIZE
from gateway.modbus.pdu import Request
from gateway.modbus.timing import LineTiming

ALLOWANCE_S = 0.02  # for adapters, drivers and this machine, on top of the unit's own response time

_ADU_EXTRA = 3  # bytes around a PDU: unit and CRC

_CLASS = log(1.05)
_SHORTEST_S = 0.0001  # what is shorter counts as this
_FORGET_FROM = 4096  # answers, then each counts half

Quantiles = dict[str, float | None]


def request_wire_s(request: Request, timing: LineTiming) -> float:
    """Return how long the request is on the wire."""
    return timing.wire_s(len(request.encode()) + _ADU_EXTRA)


def reply_within_s(
    request: Request, timing: LineTiming, *, response_time_s: float, allowance_s: float
) -> float:
    """Return how long after the request's end its reply is waited for, at most."""
    size = request.reply_size()
    reply_s = timing.wire_s(MAX_ADU_SIZE if size is None else size + _ADU_EXTRA)
    return response_time_s + reply_s + allowance_s


def longest_s(
    request: Request, timing: LineTiming, *, response_time_s: float, allowance_s: float = ALLOWANCE_S
) -> float:
    """Return how long this request can keep others from the line: no reply, then listening for a late one."""
    within_s = reply_within_s(request, timing, response_time_s=response_time_s, allowance_s=allowance_s)
    return request_wire_s(request, timing) + within_s + max(response_time_s, timing.silence_s)


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


TIMELY_ENOUGH = 3  # replies in a row that took their time, before one that did not is doubted
DOUBTS_ENOUGH = 5  # of the same reply in a row, and no other followed: here bytes need not take their time

_TOLERANCE_S = 0.0005
_CLOCKS = 0.03  # by so much a starter's bits may be shorter than ours


class Pace:
    """Whether bytes take their time on a port, so that no reply begins before its request is over.

    On a true line they do: a frame that began sooner is a copy of, or the late answer to, an earlier request.
    On a pseudo terminal or behind a network they need not, and nothing follows from when they come.
    """

    def __init__(self) -> None:
        self._timely = 0
        self._is_known_not_to = False
        self._doubts: dict[tuple[int, float], int] = {}  # in a row, by unit and length
        self._doubted: tuple[int, float] | None = None  # the latest, until it shows whether we were right

    def is_too_soon(self, unit: int, *, early_s: float, reply_s: float) -> bool:
        """Return whether a reply of this length cannot be the answer: it began `early_s` before it might."""
        if self._is_known_not_to:
            return False
        if early_s <= _TOLERANCE_S + _CLOCKS * reply_s:
            self._timely += 1
            if self._doubts:
                self._doubts.pop((unit, reply_s), None)
            return False
        if self._timely < TIMELY_ENOUGH:
            self._timely = 0
            return False
        self._doubted = (unit, reply_s)
        return True

    def note_stray(self, unit: int) -> None:
        """Record that a unit sent one more frame: it was right to doubt the one before."""
        if self._doubted is not None and self._doubted[0] == unit:
            self._doubts.pop(self._doubted, None)
            self._doubted = None

    def note_asked(self, unit: int) -> None:
        """Record that a unit is asked: had it sent one more frame, that would have come by now."""
        if self._doubted is not None and self._doubted[0] == unit:
            doubts = self._doubts[self._doubted] = self._doubts.get(self._doubted, 0) + 1
            self._is_known_not_to = doubts >= DOUBTS_ENOUGH
            self._doubted = None
