"""What was just read of one starter: the only thing that the recorders are fed with, besides records."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import NamedTuple

Value = bool | int | float | str | None


class Readings(NamedTuple):
    """The good values of one reply, with the state that follows from all that is known then.

    A point that was not read by this very reply, or that is not good, is not in `values`. The two times are
    of the reply's last byte: `at_s` on the steady clock, by which intervals are computed, `time_s` UTC.
    """

    at_s: float
    time_s: float
    state: str
    values: Mapping[str, Value]

    def number(self, point: str) -> float | None:
        """Return a measured quantity; None when it was not read, or is no finite number."""
        value = self.values.get(point)
        if not isinstance(value, (int, float)) or isinstance(value, bool) or not isfinite(value):
            return None
        return float(value)
