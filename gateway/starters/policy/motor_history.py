"""What must be remembered of each starter beyond one run: its starts, its standstill, its maintenance lock.

Inside, times are on the steady clock. Stored, they are UTC beside a reading of all clocks: the next run takes
their ages by that, and adds what has certainly passed since. No step of the wall clock makes them older.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from gateway.contract import LockRecord
from gateway.system.clock_steps import ClockReading, certain_s

LOCKS = "locks"  # the document
HISTORY_S = 3600.0  # the longest that any rule looks back
MOST_STARTS = 1000
OURS_WITHIN_S = 30.0  # a motor that begins to move this soon after our start obeys it

MOVING = frozenset({"starting", "running", "stopping"})
STANDING = frozenset({"ready", "not_ready", "fault"})


@dataclass(slots=True)
class _Page:
    """One starter; None is what is not known."""

    starts: list[float] = field(default_factory=list)
    is_moving: bool | None = None
    standing_since_s: float | None = None
    written_s: float | None = None  # our last start, until the motor is seen to move
    lock: LockRecord | None = None


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class _StoredLock(_Strict):
    by: str
    since: float
    reason: str
    operator: str | None


class _StoredPage(_Strict):
    starts: list[float] = Field(max_length=MOST_STARTS)
    moving: bool | None
    standing_since: float | None
    lock: _StoredLock | None


class _StoredReading(_Strict):
    up_s: float
    utc_s: float
    boot_id: str


class StoredMotors(_Strict):
    """What is stored of all motors: times are UTC, and `at` all clocks when it was."""

    at: _StoredReading
    starters: dict[str, _StoredPage]


MOTORS = TypeAdapter(StoredMotors)


class MotorHistory:
    """The pages of all starters; a starter of an unknown history stands still since it was first seen to."""

    def __init__(self, starters: Iterable[str]) -> None:
        self._pages = {name: _Page() for name in starters}

    def add(self, starter: str) -> None:
        """Open a page for a starter; a page that it has had before stays."""
        self._pages.setdefault(starter, _Page())

    def starts_since(self, starter: str, since_s: float) -> list[float]:
        """Return when this starter was started from `since_s` on, by us or locally; oldest first."""
        return [start_s for start_s in self._pages[starter].starts if start_s > since_s]

    def standing_since(self, starter: str) -> float | None:
        """Return since when the motor stands still; None while it moves or was never seen to stand."""
        return self._pages[starter].standing_since_s

    def lock_of(self, starter: str) -> LockRecord | None:
        """Return the maintenance lock of a starter."""
        return self._pages[starter].lock

    def set_lock(self, starter: str, lock: LockRecord | None) -> None:
        """Set or take away the maintenance lock."""
        self._pages[starter].lock = lock

    def note_start(self, starter: str, *, now_s: float) -> None:
        """Count a start that is about to be written."""
        self._count(self._pages[starter], now_s)
        self._pages[starter].written_s = now_s

    def note_state(self, starter: str, state: str, *, now_s: float) -> bool:
        """Record a state that was read; return whether there is something new to store.

        What happens while the state is not known leaves no trace here: a motor that stood before and after
        counts as standing.
        """
        page = self._pages.get(starter)
        if page is None or state not in MOVING | STANDING:
            return False
        was_moving, page.is_moving = page.is_moving, state in MOVING
        if page.is_moving is was_moving:
            return False
        if not page.is_moving:
            page.standing_since_s = now_s
            return True
        is_ours = page.written_s is not None and now_s - page.written_s <= OURS_WITHIN_S
        if was_moving is False and not is_ours:
            self._count(page, now_s)
        page.standing_since_s = page.written_s = None
        return True

    def stored(self, *, now_s: float, reading: ClockReading) -> StoredMotors:
        """Return what is to be stored now: `now_s` on the steady clock, `reading` of the machine's."""

        def utc_of(at_s: float) -> float:
            return reading.utc_s - (now_s - at_s)

        return StoredMotors(
            at=_StoredReading(up_s=reading.up_s, utc_s=reading.utc_s, boot_id=reading.boot_id),
            starters={name: _to_stored(page, utc_of) for name, page in self._pages.items()},
        )

    def restore(self, stored: StoredMotors, *, now_s: float, reading: ClockReading) -> None:
        """Apply what was stored of the configured starters."""
        before = ClockReading(stored.at.up_s, stored.at.utc_s, stored.at.boot_id)
        passed_s = certain_s(before, reading)

        def steady_of(utc_s: float) -> float:
            return now_s - passed_s - max(before.utc_s - utc_s, 0.0)

        for name, page in stored.starters.items():
            if name in self._pages:
                self._pages[name] = _from_stored(page, steady_of=steady_of)

    def _count(self, page: _Page, now_s: float) -> None:
        recent = [start_s for start_s in page.starts if start_s > now_s - HISTORY_S]
        page.starts = [*recent, now_s][-MOST_STARTS:]


def _to_stored(page: _Page, utc_of: Callable[[float], float]) -> _StoredPage:
    lock, since_s = page.lock, page.standing_since_s
    return _StoredPage(
        starts=[utc_of(start_s) for start_s in page.starts],
        moving=page.is_moving,
        standing_since=None if since_s is None else utc_of(since_s),
        lock=None
        if lock is None
        else _StoredLock(by=lock.by, since=lock.since_s, reason=lock.reason, operator=lock.operator),
    )


def _from_stored(stored: _StoredPage, *, steady_of: Callable[[float], float]) -> _Page:
    """Return a page; `steady_of` converts a stored time to one of the steady clock."""
    lock, since = stored.lock, stored.standing_since
    return _Page(
        starts=[steady_of(start) for start in stored.starts],
        is_moving=stored.moving,
        standing_since_s=None if since is None else steady_of(since),
        lock=None
        if lock is None
        else LockRecord(by=lock.by, since_s=lock.since, reason=lock.reason, operator=lock.operator),
    )
