"""For how long a reply may still come that nobody waits for any more.

RTU replies carry no number: a late one looks like the answer to the next request of the same shape. So the
line listens on for a while after a request that was not answered, and longer before it asks that unit again.
"""

from __future__ import annotations

from math import inf

from gateway.errors import BadFrameError
from gateway.modbus import adu


class Quarantine:
    """What each unit may still owe."""

    def __init__(self) -> None:
        self._line_unit: int | None = None
        self._line_until_s = -inf
        self._unit_until_s: dict[int, float] = {}
        self._latest_until_s = -inf

    def begin(self, unit: int, *, line_until_s: float, unit_until_s: float) -> None:
        """Expect a late reply of this unit: nobody is asked until the one time, the unit until the other."""
        self._line_unit = unit
        self._line_until_s = line_until_s
        self._unit_until_s[unit] = unit_until_s
        self._latest_until_s = max(self._latest_until_s, unit_until_s)

    def hold(self, unit: int, until_s: float) -> None:
        """Expect one more reply of this unit until then, though it has answered; others may be asked."""
        self.end(unit)
        self._unit_until_s[unit] = until_s

    def owes(self, unit: int) -> bool:
        """Return whether a reply of this unit is still expected, or was and never came."""
        return unit in self._unit_until_s

    def is_anyone_late(self, now_s: float) -> bool:
        """Return whether a late reply, or the copy of one, may still come of anyone."""
        return now_s < self._latest_until_s

    def end(self, unit: int) -> None:
        """Expect nothing of this unit any more: it has answered."""
        self._unit_until_s.pop(unit, None)
        if unit == self._line_unit:
            self._line_until_s = -inf

    def heard(self, stray: bytes) -> bool:
        """Take note of bytes that nobody waited for: a whole frame of a unit is what it owed.

        Returns whether it is a whole frame.
        """
        try:
            self.end(adu.decode(stray).unit)
        except BadFrameError:
            return False
        return True

    def until_s(self, unit: int | None = None) -> float:
        """Return when the line may be used, and when this unit may be asked again."""
        if unit is None:
            return self._line_until_s
        return max(self._line_until_s, self._unit_until_s.get(unit, -inf))
