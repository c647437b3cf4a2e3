"""The jobs that wait, by priority, and the share of the line that they may take from polls that are due."""

from __future__ import annotations

from bisect import insort, insort_left
from dataclasses import replace
from math import inf
from operator import attrgetter

from gateway.line.scheduler.line_time import JOBS_BURST_S, JOBS_SHARE, LineTimeBudget
from gateway.line.scheduler.requests import Job, Priority, Slot

BACKGROUND_WEIGHT = 2  # background jobs are charged so many times their line time: they get a quarter
OLDEST_EVERY = 4  # of so many jobs one is the oldest, whatever its priority
COMMANDS = (Priority.COMMAND, Priority.READ_BACK, Priority.PARAMETERS)
SHARED_AFTER_S = 0.1  # a stop's frame that has waited so long is sent for later stops of its unit too


class JobQueue:
    """The slots that wait: by priority, those of one priority as they were submitted."""

    def __init__(self) -> None:
        self._budget = LineTimeBudget(JOBS_SHARE, JOBS_BURST_S)
        self._waiting: list[Slot] = []
        self._commands = 0  # taken out

    def submit(self, job: Job, now_s: float) -> None:
        """Queue a job behind the others of its priority.

        A stop joins a frame of its unit that has waited for long and leaves later than the stop came: a group
        that is stopped again and again costs the line one frame each, not many.
        """
        for place, slot in enumerate(self._waiting) if job.lane is Priority.STOP else ():
            is_same = (slot.lane, slot.unit, slot.request) == (job.lane, job.unit, job.request)
            if is_same and now_s - slot.since_s > SHARED_AFTER_S:
                self._waiting[place] = replace(slot, jobs=(*slot.jobs, job))
                return
        slot = Slot(job.unit, job.request, job.response_time_s, now_s, lane=job.lane, jobs=(job,))
        insort(self._waiting, slot, key=attrgetter("lane"))

    def withdraw(self, job: Job) -> bool:
        """Take a job back; False when it is not waiting (any more)."""
        for place, slot in enumerate(self._waiting):
            if job in slot.jobs:
                left = slot.without(job)
                self._waiting[place : place + 1] = [] if left is None else [left]
                return True
        return False

    def clear(self) -> tuple[Job, ...]:
        """Return all waiting jobs and forget them."""
        slots, self._waiting = self._waiting, []
        return tuple(job for slot in slots for job in slot.jobs)

    def put_back(self, slot: Slot, until_s: float) -> None:
        """Return a slot to the head of its priority, from `until_s` on; others pass it meanwhile."""
        insort_left(self._waiting, replace(slot, not_before_s=until_s), key=attrgetter("lane"))

    def next_s(self) -> float:
        """Return from when on there is a job to send."""
        return min([slot.not_before_s for slot in self._waiting], default=inf)

    def pop(self, now_s: float, *lanes: Priority) -> Slot | None:
        """Take out the next job of these priorities: by priority, of `COMMANDS` now and then the oldest."""
        ready = self._waiting and [
            slot for slot in self._waiting if slot.lane in lanes and slot.not_before_s <= now_s
        ]
        if not ready:
            return None
        self._commands += lanes == COMMANDS
        is_oldest = lanes == COMMANDS and self._commands % OLDEST_EVERY == 0
        slot = min(ready, key=attrgetter("since_s")) if is_oldest else ready[0]
        self._waiting.remove(slot)
        return slot

    def may_pass_polls(self, now_s: float) -> bool:
        """Return whether jobs may take time from polls that are due."""
        return now_s >= self._budget.room_at_s()

    def charge(self, slot: Slot, took_s: float, now_s: float) -> None:
        """Charge what a slot has used of the line to the jobs' share; stops are free."""
        if slot.lane in COMMANDS:
            weight = BACKGROUND_WEIGHT if slot.lane is Priority.PARAMETERS else 1
            self._budget.spend(weight * took_s, now_s)
