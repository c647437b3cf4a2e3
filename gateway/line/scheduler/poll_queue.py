"""Which poll is next: by deadline, with a bound on how long any kind of poll waits for another."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

from gateway.line.scheduler.backoff import SilenceBudget
from gateway.line.scheduler.edf_queue import NOWHERE, EdfQueue
from gateway.line.scheduler.load import FREE_ROOM, LoadControl
from gateway.line.scheduler.units import GUESSED_COST_S, ScheduledPoll


class PollQueue:
    """The polls that wait: with a period, without one, of units that missed once, of silent units.

    After a silence the units that answer come first, so that silence never blocks the line twice in a row
    while anything else is due.
    """

    def __init__(self, places: Iterator[int], stretch: LoadControl) -> None:
        self.budget = SilenceBudget()
        self.is_after_silence = False
        self._stretch = stretch
        self._timed: EdfQueue[ScheduledPoll] = EdfQueue(places)
        self._free: EdfQueue[ScheduledPoll] = EdfQueue(places)
        self._suspect: EdfQueue[ScheduledPoll] = EdfQueue(places)
        self._silent: EdfQueue[ScheduledPoll] = EdfQueue(places)
        self._free_from_s = inf  # polls without a period go before the others then, for their share

    def begin(self, now_s: float) -> None:
        """Begin on an opened port."""
        self.budget.begin(now_s)
        self._free_from_s = now_s + GUESSED_COST_S / FREE_ROOM

    def put(self, entry: ScheduledPoll) -> None:
        """Let a poll wait from its release on; it leaves the place where it waited before."""
        entry.is_out = False
        if entry.unit.is_held:
            entry.deadline_s = -inf if entry.is_hastened else entry.release_s
            self._silent.put(entry)
        elif entry.unit.is_suspect:
            self._suspect.put(entry)
        elif entry.deadline_s == inf:
            self._free.put(entry)
        else:
            self._timed.put(entry)

    def drop(self, entry: ScheduledPoll) -> None:
        """Let a poll wait no longer."""
        entry.place = NOWHERE

    def take(self, entry: ScheduledPoll, now_s: float) -> None:
        """Take out the poll that is asked now."""
        if entry.deadline_s == inf:
            self._free_from_s = now_s + entry.cost_s / FREE_ROOM
        entry.is_out, entry.place = True, NOWHERE

    def first(self, now_s: float) -> ScheduledPoll | None:
        """Return what is next."""
        if self.is_after_silence:
            return self._of_answering(now_s) or self._of_others(now_s)
        return self._of_others(now_s) or self._of_answering(now_s)

    def next_s(self) -> float:
        """Return when `first` will return something; a little early at times, never late."""
        return min(
            _next_s(self._timed),
            self._early_s(),
            _next_s(self._free),
            _next_s(self._suspect),
            self._probe_s(),
        )

    def _of_answering(self, now_s: float) -> ScheduledPoll | None:
        timed = self._timed.first(now_s)
        if timed is not None and now_s < self._free_from_s:
            return timed
        free = self._free.first(now_s)
        if free is not None:
            return free
        if timed is None and self._early_s() <= now_s:
            return self._timed.upcoming()
        return timed

    def _of_others(self, now_s: float) -> ScheduledPoll | None:
        suspect = self._suspect.first(now_s)
        if suspect is not None:
            return suspect
        probe = self._silent.first(now_s)
        return probe if probe is not None and self._affordable_s(probe) <= now_s else None

    def _early_s(self) -> float:
        """Return from when on an idle but over-full line asks what is due next."""
        entry = self._timed.upcoming()
        return inf if entry is None or self._stretch.factor <= 1.0 else entry.soonest_s

    def _probe_s(self) -> float:
        waiting = (self._silent.released(), self._silent.upcoming())
        return min((self._affordable_s(entry) for entry in waiting if entry is not None), default=inf)

    def _affordable_s(self, entry: ScheduledPoll) -> float:
        if entry.release_s < entry.unit.patient_until_s:
            return entry.release_s
        from_s = self.budget.from_s(entry.unit.miss_cost_s, in_advance=entry.is_hastened)
        return max(entry.release_s, from_s)


def _next_s(agenda: EdfQueue[ScheduledPoll]) -> float:
    released, upcoming = agenda.released(), agenda.upcoming()
    return min(
        inf if released is None else released.release_s, inf if upcoming is None else upcoming.release_s
    )
