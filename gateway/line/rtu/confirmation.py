"""Which readings of decisive points count on a disturbed line: two that agree, of different shapes; pure.

Where a reading has one shape only, two of that shape must agree.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Any

from gateway.line.rtu.late_replies import Shape

MOST_TRIES = 3  # readings in a row that say something new, before their poll waits for its next time


class Reading(enum.Enum):
    """What becomes of a reading."""

    COUNTS = enum.auto()
    AGAIN = enum.auto()  # it is read once more, at once
    OPEN = enum.auto()  # no two readings agree
    WAITS = enum.auto()  # it cannot be told from an earlier one now: it is read again later


@dataclass(slots=True)
class _Candidate:
    part: Any
    shape: Shape
    tries: int = 1


class Confirmation:
    """The decisive parts of the polls of one line, by the polls' keys."""

    def __init__(self) -> None:
        self._counted: dict[str, Any] = {}
        self._candidates: dict[str, _Candidate] = {}

    def take(
        self, key: str, part: Any, shape: Shape, *, is_disturbed: bool, has_alternates: bool = True
    ) -> Reading:
        """Return whether a reading counts whose decisive part is this."""
        candidate = self._candidates.get(key)
        if not is_disturbed or (key in self._counted and self._counted[key] == part):
            return self._count(key, part)
        if candidate is None:
            self._candidates[key] = _Candidate(part, shape)
            return Reading.AGAIN
        if candidate.part == part:
            if candidate.shape != shape or not has_alternates:
                return self._count(key, part)
        else:
            candidate.part, candidate.shape = part, shape
        candidate.tries += 1
        if candidate.tries < MOST_TRIES:
            return Reading.AGAIN
        candidate.tries = 0
        return Reading.OPEN

    def forget(self, key: str) -> None:
        """Drop what is known of a poll that is gone."""
        self._counted.pop(key, None)
        self._candidates.pop(key, None)

    def _count(self, key: str, part: Any) -> Reading:
        self._counted[key] = part
        self._candidates.pop(key, None)
        return Reading.COUNTS
