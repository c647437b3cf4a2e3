"""The jobs that wait, by priority, and the share of the line that they may take from polls that are due."""

from __future__ import annotations

from dataclasses import replace
from math import inf

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
        self._waiting: dict[Priority, list[Slot]] = {lane: [] for lane in Priority}
        self._popped = 0

    def submit(self, job: Job, now_s: float) -> None:
        """Queue a job behind the others of its priority.

        A stop joins a frame of its unit that has waited for long and leaves later than the stop came: a group
        that is stopped again and again costs the line one frame each, not many.
        """
        waiting = self._waiting[job.lane]
        for place, slot in enumerate(waiting) if job.lane is Priority.STOP else ():
            is_same = (slot.unit, slot.request) == (job.unit, job.request)
            if is_same and now_s - slot.since_s > SHARED_AFTER_S:
                waiting[place] = replace(slot, jobs=(*slot.jobs, job))
                return
        waiting.append(Slot(job.unit, job.request, job.response_time_s, now_s, lane=job.lane, jobs=(job,)))

    def withdraw(self, job: Job) -> bool:
        """Take a job back; False when it is not waiting (any more)."""
        waiting = self._waiting[job.lane]
        for place, slot in enumerate(waiting):
            if any(each is job for each in slot.jobs):
                left = slot.without(job)
                waiting[place : place + 1] = [] if left is None else [left]
                return True
        return False

    def clear(self) -> tuple[Job, ...]:
        """Return all waiting jobs and forget them."""
        jobs = tuple(job for waiting in self._waiting.values() for slot in waiting for job in slot.jobs)
        for waiting in self._waiting.values():
            waiting.clear()
        return jobs

    def put_back(self, slot: Slot, until_s: float = -inf) -> None:
        """Return a slot to the head of its priority, from `until_s` on; others pass it meanwhile."""
        self._waiting[slot.jobs[0].lane].insert(0, replace(slot, not_before_s=until_s))

    def next_s(self) -> float:
        """Return from when on there is a job to send."""
        slots = (slot for waiting in self._waiting.values() for slot in waiting)
        return min((slot.not_before_s for slot in slots), default=inf)

    def pop(self, now_s: float, *lanes: Priority) -> Slot | None:
        """Take out the next job of these priorities, the first of them first."""
        for lane in lanes:
            for place, slot in enumerate(self._waiting[lane]):
                if slot.not_before_s <= now_s:
                    return self._waiting[lane].pop(place)
        return None

    def pop_command(self, now_s: float, *, is_poll_due: bool) -> Slot | None:
        """Take out the next job that is not of a stop: by priority, now and then the oldest instead.

        None when a poll is due and the jobs' share of the line's time is used up.
        """
        ready = []  # the first of each priority
        for lane in COMMANDS:
            for slot in self._waiting[lane]:
                if slot.not_before_s <= now_s:
                    ready.append(slot)
                    break
        if not ready or (is_poll_due and not self.may_pass_polls(now_s)):
            return None
        self._popped += 1
        is_oldest = self._popped % OLDEST_EVERY == 0
        chosen = min(ready, key=lambda slot: slot.since_s) if is_oldest else ready[0]
        self._waiting[chosen.jobs[0].lane].remove(chosen)
        return chosen

    def may_pass_polls(self, now_s: float) -> bool:
        """Return whether jobs may take time from polls that are due."""
        return self._budget.has_room(now_s)

    def charge(self, slot: Slot, took_s: float, now_s: float) -> None:
        """Charge what a slot has used of the line to the jobs' share; stops are free."""
        if slot.lane is not None and slot.lane > Priority.FOLLOW_UP:
            weight = BACKGROUND_WEIGHT if slot.lane is Priority.PARAMETERS else 1
            self._budget.spend(weight * took_s, now_s)
