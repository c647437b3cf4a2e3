"""Whether the wall clock was stepped while the gateway ran, by a person or a service.

The kernel moves the wall clock and the clock since boot alike, also when a time service slews them; only a
step changes their difference. After a step the wall clock proves nothing about other clocks for SETTLED_S.
"""

from __future__ import annotations

from dataclasses import dataclass

STEP_S = 0.5  # more than two readings of the clocks can lie apart; a leap second counts as a step
SETTLED_S = 60.0  # as long as a command can be valid


@dataclass(frozen=True, slots=True)
class ClockReading:
    """Both clocks at one moment."""

    up_s: float  # since boot, sleep included
    utc_s: float  # the wall's
    boot_id: str = ""  # of the machine's boot; empty when it cannot be read

    @property
    def offset_s(self) -> float:
        """Return the wall time at which the machine was booted, by the present clock."""
        return self.utc_s - self.up_s


def certain_s(before: ClockReading, now: ClockReading) -> float:
    """Return how long ago `before` was at least, whatever has been done to the wall clock since.

    Over a restart of the machine that is the time since its boot; how long it was off, no other clock says.
    """
    is_same_boot = before.boot_id == now.boot_id
    if is_same_boot and now.up_s >= before.up_s:
        return now.up_s - before.up_s
    return now.up_s


class ClockSteps:
    """Compares readings; `doubt` says in words what has happened, None while nothing has."""

    def __init__(self) -> None:
        self.doubt: str | None = None
        self._offset_s: float | None = None  # before the latest step: smaller ones add up
        self._stepped_s = 0.0

    def look(self, now: ClockReading) -> bool:
        """Take a reading and return whether `doubt` has changed."""
        before = self.doubt
        step_s = 0.0 if self._offset_s is None else now.offset_s - self._offset_s
        if self._offset_s is None or abs(step_s) > STEP_S:
            self._offset_s = now.offset_s
        if abs(step_s) > STEP_S:
            self.doubt = (
                f"this gateway's clock was set {'ahead' if step_s > 0 else 'back'} by {abs(step_s):.1f} s"
            )
            self._stepped_s = now.up_s
        elif self.doubt is not None and now.up_s - self._stepped_s >= SETTLED_S:
            self.doubt = None
        return self.doubt != before
