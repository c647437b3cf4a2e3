"""Whether the wall clock has been stepped: set by a person or a service, while we run or between two runs.

The kernel moves the wall clock and the clock since boot alike, also when a time service slews them; only a
step changes their difference. So the difference now is compared with the one of before:

1. while running, and over a restart of the gateway alone (same boot): it must be the same;
2. over a restart of the machine: the machine's boot must lie after what the wall clock showed last.

After a step the wall clock proves nothing about other clocks until the kernel, or the configuration, has
called it synchronised for SETTLED_S, without a further step. That doubt outlives the process.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

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
        self._last: ClockReading | None = None
        self._steady_since_s: float | None = None

    def recall(self, document: Mapping[str, Any] | None, now: ClockReading) -> None:
        """Compare with what an earlier run has stored; a document of another shape counts as none."""
        self._last = now
        try:
            before = _reading(document or {})
        except (KeyError, TypeError, ValueError):
            return
        stored_doubt = (document or {}).get("doubt")
        self.doubt = stored_doubt if isinstance(stored_doubt, str) else None
        step_s = _step_between_runs_s(before, now)
        if step_s is not None:
            self.doubt = f"this gateway's clock was set {_by(step_s)} between two runs"

    def look(self, now: ClockReading, *, is_synchronised: Callable[[], bool]) -> bool:
        """Take a reading and return whether `doubt` has changed; `is_synchronised` is asked only in doubt."""
        before_s, last, self._last = self.doubt, self._last or now, now
        step_s = now.offset_s - last.offset_s
        if abs(step_s) > STEP_S:
            self.doubt = f"this gateway's clock was set {_by(step_s)}"
            self._steady_since_s = None
        else:
            # Steps of less than STEP_S add up, so what is compared with stays the same.
            self._last = ClockReading(now.up_s, last.offset_s + now.up_s, now.boot_id)
        if self.doubt is not None:
            self._settle(now, is_synchronised=is_synchronised)
        return self.doubt != before_s

    def document(self, now: ClockReading) -> dict[str, Any]:
        """Return what the next run must know."""
        return {"utc_s": now.utc_s, "up_s": now.up_s, "boot_id": now.boot_id, "doubt": self.doubt}

    def _settle(self, now: ClockReading, *, is_synchronised: Callable[[], bool]) -> None:
        if not is_synchronised():
            self._steady_since_s = None
            return
        if self._steady_since_s is None:
            self._steady_since_s = now.up_s
        if now.up_s - self._steady_since_s >= SETTLED_S:
            self.doubt = None
            self._steady_since_s = None


def _step_between_runs_s(before: ClockReading, now: ClockReading) -> float | None:
    """Return by how much the clock was set since an earlier run, at least; None when nothing shows it."""
    moved_s = now.offset_s - before.offset_s
    if abs(moved_s) <= STEP_S:
        return None
    if before.boot_id and before.boot_id == now.boot_id:
        return moved_s
    booted_after_s = now.offset_s - before.utc_s
    return booted_after_s if booted_after_s < -STEP_S else None


def _reading(document: Mapping[str, Any]) -> ClockReading:
    return ClockReading(float(document["up_s"]), float(document["utc_s"]), str(document["boot_id"]))


def _by(step_s: float) -> str:
    return f"{'ahead' if step_s > 0 else 'back'} by {abs(step_s):.1f} s"
