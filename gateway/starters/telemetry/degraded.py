"""What cannot be read: polls that are lost (`PollLoss`), rows that are refused (`Refusals`); pure.

A poor line is not a lost starter, and a single refusal proves nothing:

1. A block that is refused three times in a row is asked for row by row, and once every row was answered as a
   whole again.
2. A row that decides state, fault or watchdog is never given up: it is asked again ever less often, at the
   latest every `LONGEST_PAUSE_S`.
3. Any other row is given up after `ENOUGH` refusals at least `APART_S` apart, and tried again after
   `AGAIN_AFTER_S`, and after each silence.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from gateway.families.diagnosis.readiness import watchdog_codes
from gateway.families.profile.per_profile import once_per_profile
from gateway.families.profile.schema import Profile
from gateway.families.reading.bulk import rows_of_points
from gateway.system.backoff import backoff_s

OF = 200  # polls are looked at
_ALL = (1 << OF) - 1
POOR, GOOD_AGAIN = 8, 3  # of them lost: from 4 % on it is said, until it is 1.5 % or less


class PollLoss:
    """Counts the lost polls of one starter among its latest."""

    def __init__(self) -> None:
        self._latest = 0  # a bit for each, 1 for a lost one; the latest is the lowest
        self._count = self._lost = 0
        self._is_poor = False

    def note(self, *, is_lost: bool) -> str | None:
        """Count a poll; return what is wrong, "" once nothing is any more, None for no news."""
        self._lost += is_lost - (self._latest >> (OF - 1))
        self._latest = (self._latest << 1 | is_lost) & _ALL
        self._count = min(self._count + 1, OF)
        was_poor = self._is_poor
        self._is_poor = self._lost >= POOR or (was_poor and self._lost > GOOD_AGAIN)
        if self._is_poor is was_poor:
            return None
        return f"{self._lost} of its last {self._count} polls had no right reply" if self._is_poor else ""

    def clear(self) -> None:
        """Count anew: the starter itself was lost."""
        self._latest = self._count = self._lost = 0
        self._is_poor = False


IN_ROW = 3  # refusals of a block, before it is asked for row by row; of a row, before it counts as refused
ENOUGH = 3  # refusals of a row
APART_S = 10.0
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 5.0
AGAIN_AFTER_S = 3600.0
REJOINED_AFTER_S = 15.0  # after the first split of a block; four times as long after each further one


@dataclass(slots=True)
class Refusals:
    """The refusals of one request since it was answered last."""

    in_row: int = 0
    apart: int = 0
    _counted_s: float = -inf

    def note(self, now_s: float) -> None:
        """Count a refusal."""
        self.in_row += 1
        if now_s - self._counted_s >= APART_S:
            self.apart, self._counted_s = self.apart + 1, now_s

    def clear(self) -> None:
        """Count anew: it was answered."""
        self.in_row, self.apart, self._counted_s = 0, 0, -inf

    @property
    def pause_s(self) -> float:
        """Return how long to wait at least before it is asked again; 0 when it is not refused."""
        if not self.in_row:
            return 0.0
        return backoff_s(FIRST_PAUSE_S, LONGEST_PAUSE_S, self.in_row - 1)


@dataclass(slots=True)
class Splits:
    """How often a block was asked for row by row, and when last."""

    count: int = 0
    since_s: float = -inf

    def note(self, now_s: float) -> None:
        """Count a split."""
        self.count, self.since_s = self.count + 1, now_s

    def is_over(self, now_s: float) -> bool:
        """Return whether the block may be asked for as a whole again."""
        pause_s = backoff_s(REJOINED_AFTER_S, AGAIN_AFTER_S, self.count - 1, factor=4.0)
        return now_s - self.since_s >= pause_s


@once_per_profile
def vital_codes(profile: Profile) -> frozenset[str]:
    """Return the rows that decide state, fault or watchdog and that the starter surely has."""
    status = (name for name, point in profile.points.items() if point.group == "status")
    codes = (*rows_of_points(profile, (*status, *_numbers(profile))), *watchdog_codes(profile))
    return frozenset(code for code in codes if profile.parameters[code].is_sure)


def _numbers(profile: Profile) -> tuple[str, ...]:
    return ("fault_code",) if "fault_code" in profile.points else ()
