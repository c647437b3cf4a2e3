"""What must be remembered of each starter beyond one run: its starts, its standstill, its maintenance lock.

Inside, times are on the steady clock. Stored, they are UTC beside a reading of all clocks: the next run takes
their ages by that, and adds what has certainly passed since. No step of the wall clock makes them older.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import inf
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from gateway.contract import LockRecord
from gateway.system.clock import ClockReading, certain_s

LOCKS = "locks"  # the document
HISTORY_S = 3600.0  # the longest that any rule looks back
MOST_STARTS = 1000
OURS_WITHIN_S = 30.0  # a motor that begins to move this soon after our start obeys it

MOVING = frozenset({"starting", "running", "stopping"})
STANDING = frozenset({"ready", "not_ready", "fault"})


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class _Lock(_Strict):
    by: str
    since: float  # UTC
    reason: str
    operator: str | None


class _Page(_Strict):
    """One starter; None is what is not known."""

    starts: list[float] = Field(max_length=MOST_STARTS)
    moving: bool | None
    standing_since: float | None
    lock: _Lock | None

    def dated(self, to: Callable[[float], float]) -> _Page:
        """Return the same page with its times on another clock."""
        since = self.standing_since
        since = None if since is None else to(since)
        return self.model_copy(update={"starts": [to(at) for at in self.starts], "standing_since": since})


class StoredMotors(_Strict):
    """What is stored of all motors: times are UTC, and `at` all clocks when it was."""

    at: ClockReading
    starters: dict[str, _Page]


MOTORS = TypeAdapter(StoredMotors)
_NEW = _Page(starts=[], moving=None, standing_since=None, lock=None)


class MotorHistory:
    """The pages of all starters; a starter of an unknown history stands still since it was first seen to."""

    def __init__(self) -> None:
        self.on_change: Callable[[], None] = lambda: None  # what is stored differs now
        self._pages: dict[str, _Page] = {}
        self._written_s: dict[str, float] = {}  # our last start of each, until its motor is seen to move

    def starts_since(self, starter: str, since_s: float) -> list[float]:
        """Return when this starter was started from `since_s` on, by us or locally; oldest first."""
        return [start_s for start_s in self._page(starter).starts if start_s > since_s]

    def standing_since(self, starter: str) -> float | None:
        """Return since when the motor stands still; None while it moves or was never seen to stand."""
        return self._page(starter).standing_since

    def lock_of(self, starter: str) -> LockRecord | None:
        """Return the maintenance lock of a starter."""
        lock = self._page(starter).lock
        if lock is None:
            return None
        return LockRecord(by=lock.by, since_s=lock.since, reason=lock.reason, operator=lock.operator)

    def set_lock(self, starter: str, lock: LockRecord | None) -> None:
        """Set or take away the maintenance lock."""
        stored = lock and _Lock(by=lock.by, since=lock.since_s, reason=lock.reason, operator=lock.operator)
        self._change(starter, lock=stored)

    def note_start(self, starter: str, *, now_s: float) -> None:
        """Count a start that is about to be written."""
        self._count(starter, now_s)
        self._written_s[starter] = now_s

    def note_state(self, starter: str, state: str, *, now_s: float) -> None:
        """Record a state that was read.

        What happens while the state is not known leaves no trace here: a motor that stood before and after
        counts as standing.
        """
        page = self._page(starter)
        is_moving = state in MOVING
        if state not in MOVING | STANDING or is_moving is page.moving:
            return
        if is_moving:
            written_s = self._written_s.pop(starter, -inf)
            if page.moving is False and now_s - written_s > OURS_WITHIN_S:
                self._count(starter, now_s)
        self._change(starter, moving=is_moving, standing_since=None if is_moving else now_s)

    def watch_only(self, starters: Iterable[str]) -> None:
        """Forget since when all other motors stand still: their states are not read from now on."""
        for name in self._pages.keys() - set(starters):
            if self._pages[name].moving is not None:
                self._change(name, moving=None, standing_since=None)

    def stored(self, *, now_s: float, reading: ClockReading) -> StoredMotors:
        """Return what is to be stored now: `now_s` on the steady clock, `reading` of the machine's."""

        def utc_of(at_s: float) -> float:
            return reading.utc_s - (now_s - at_s)

        pages = {name: page.dated(utc_of) for name, page in self._pages.items()}
        return StoredMotors(at=reading, starters=pages)

    def restore(self, stored: StoredMotors, *, now_s: float, reading: ClockReading) -> None:
        """Apply what was stored."""
        passed_s = certain_s(stored.at, reading)

        def steady_of(utc_s: float) -> float:
            return now_s - passed_s - max(stored.at.utc_s - utc_s, 0.0)

        self._pages = {name: page.dated(steady_of) for name, page in stored.starters.items()}

    def _page(self, starter: str) -> _Page:
        return self._pages.get(starter, _NEW)

    def _count(self, starter: str, now_s: float) -> None:
        starts = [*self.starts_since(starter, now_s - HISTORY_S), now_s][-MOST_STARTS:]
        self._change(starter, starts=starts)

    def _change(self, starter: str, **changes: Any) -> None:
        self._pages[starter] = self._page(starter).model_copy(update=changes)
        self.on_change()
