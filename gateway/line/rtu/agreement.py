"""Readings in a form whose reply their unit may owe already: so many equal answers count as one; pure.

Where n earlier replies may still come, n of the answers to n + 1 requests may be those; the one that is left
is fresh. When all are equal, so is what it says.
"""

from __future__ import annotations

import enum
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

from gateway.line.prepared import Prepared
from gateway.line.rtu.late_replies import Shape

UNDER_WAY_S = 0.5  # for so long after its latest answer nobody else is asked in the form of a series
PAUSES_S = (0.5, 4.0, 8.0, 16.0)  # after so many series in a row whose answers differed
PATIENCE_S = 4.0  # for so long a read that decides nothing waits for a reply to come before it is read so
FORGOTTEN_S = 2.0  # a read that was not looked at for so long does not wait any more
KEPT_S = 30.0  # pauses are remembered for so long


class Agreed(enum.Enum):
    """What one more answer makes of a series."""

    YES = enum.auto()
    NOT_YET = enum.auto()
    NO = enum.auto()  # it said something else than the one before


@dataclass(slots=True)
class _Series:
    key: Hashable
    value: Any
    needed: int
    sent: int  # how many requests of its form there were on this line
    at_s: float
    answers: int = 1


@dataclass(slots=True)
class _Pause:
    from_s: float
    series: int  # in a row

    @property
    def until_s(self) -> float:
        return self.from_s + PAUSES_S[min(self.series, len(PAUSES_S)) - 1]


class Agreement:
    """The series of one line, by unit and shape; times in seconds on the line's clock."""

    def __init__(self) -> None:
        self._series: dict[tuple[int, Shape], _Series] = {}
        self._pauses: dict[Hashable, _Pause] = {}
        self._patient: dict[Hashable, tuple[float, float]] = {}  # since when reads wait, and looked at last

    def may_ask(self, form: Prepared, key: Hashable, now_s: float, *, is_decisive: bool) -> bool:
        """Return whether this may be read in a series now: none of another read is under way in this form."""
        if not is_decisive and self._waited_s(key, now_s) < PATIENCE_S:
            return False
        pause = self._pauses.get(key)
        if pause is not None and now_s < pause.until_s:
            return False
        series = self._series.get((form.unit, form.shape))
        return series is None or series.key == key or now_s - series.at_s >= UNDER_WAY_S

    def take(self, form: Prepared, key: Hashable, value: Any, *, sent: int, now_s: float) -> Agreed:
        """Take over the answer to the request of this form with that number."""
        place = (form.unit, form.shape)
        series = self._series.pop(place, None)
        if series is None or series.key != key or series.sent + 1 != sent:
            self._series[place] = _Series(key, value, form.times, sent, now_s)
            return Agreed.NOT_YET
        if series.value != value:
            self._pause(key, now_s)
            return Agreed.NO
        series.answers += 1
        series.sent, series.at_s = sent, now_s
        if series.answers < series.needed:
            self._series[place] = series
            return Agreed.NOT_YET
        self._pauses.pop(key, None)
        return Agreed.YES

    def _waited_s(self, key: Hashable, now_s: float) -> float:
        since_s, looked_s = self._patient.get(key, (now_s, now_s))
        if now_s - looked_s > FORGOTTEN_S:
            since_s = now_s
        self._patient[key] = since_s, now_s
        return now_s - since_s

    def _pause(self, key: Hashable, now_s: float) -> None:
        before = self._pauses.pop(key, None)
        self._pauses = {each: pause for each, pause in self._pauses.items() if now_s - pause.from_s < KEPT_S}
        self._pauses[key] = _Pause(now_s, 1 if before is None else before.series + 1)
