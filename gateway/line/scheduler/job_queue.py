"""The jobs that wait, each in its lane.

How much of a full line's time jobs may take from the polls that are due meanwhile.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from math import inf

from gateway.line.scheduler.requests import Job, Priority, Slot

LET_PASS = 4  # jobs of earlier lanes that one which waits lets pass; those of stops do not count
SHARED_AFTER_S = 0.1  # a stop's frame that has waited so long is sent for later stops of its unit too


class JobQueue:
    """One queue for each lane."""

    def __init__(self) -> None:
        self._waiting: dict[Priority, deque[Slot]] = {lane: deque() for lane in Priority}
        self._let_pass = dict.fromkeys(Priority, 0)
        self._held: list[tuple[float, Job, Slot]] = []  # those whose unit may not be asked before then

    def __bool__(self) -> bool:
        return any(self._waiting.values())

    def submit(self, job: Job, now_s: float) -> None:
        """Queue a job at the end of its lane."""
        if job.lane is not Priority.STOP or not self._ride(job, now_s):
            turn = Slot(job.unit, job.request, job.response_time_s, now_s, job=job)
            self._waiting[job.lane].append(turn)

    def put_first(self, job: Job, turn: Slot) -> None:
        """Queue a job's turn before the others of its lane."""
        self._waiting[job.lane].appendleft(turn)

    def hold(self, job: Job, turn: Slot, until_s: float) -> None:
        """Let a job's turn wait until its unit may be asked; others pass it meanwhile."""
        self._held.append((until_s, job, turn))

    def release(self, now_s: float) -> None:
        """Let those wait in their lane again whose unit may be asked now."""
        if not self._held:
            return
        for until_s, job, turn in reversed(self._held):
            if until_s <= now_s:
                self.put_first(job, turn)
        self._held = [each for each in self._held if each[0] > now_s]

    def next_s(self) -> float:
        """Return when the first of those that are held may be asked."""
        return min((until_s for until_s, _, _ in self._held), default=inf)

    def take(self, last: Priority) -> Slot | None:
        """Take out what is next in these lanes, from `STOP` to the last."""
        waiting = [lane for lane, turns in self._waiting.items() if turns and lane <= last]
        if not waiting:
            return None
        chosen = waiting[0]
        if chosen > Priority.FOLLOW_UP:
            chosen = next((lane for lane in waiting if self._let_pass[lane] >= LET_PASS), chosen)
            for lane in waiting:
                self._let_pass[lane] = 0 if lane is chosen else self._let_pass[lane] + 1
        return self._waiting[chosen].popleft()

    def withdraw(self, job: Job) -> bool:
        """Take a job back; False when it is not waiting (any more)."""
        for place, (_, held, _) in enumerate(self._held):
            if held is job:
                del self._held[place]
                return True
        turns = self._waiting[job.lane]
        for place, turn in enumerate(turns):
            if any(each is job for each in turn.jobs):
                left = turn.without(job)
                if left is None:
                    del turns[place]
                else:
                    turns[place] = left
                return True
        return False

    def clear(self) -> tuple[Job, ...]:
        """Return all waiting jobs and forget them."""
        self.release(inf)
        jobs = tuple(job for turns in self._waiting.values() for turn in turns for job in turn.jobs)
        for turns in self._waiting.values():
            turns.clear()
        return jobs

    def _ride(self, job: Job, now_s: float) -> bool:
        """Let a frame that has waited for long be sent for this stop as well; it leaves later than this came.

        So a group of many that is stopped again and again costs the line one lap, not many.
        """
        turns = self._waiting[job.lane]
        for place, turn in enumerate(turns):
            if (turn.unit, turn.request) == (job.unit, job.request) and now_s - turn.since_s > SHARED_AFTER_S:
                turns[place] = replace(turn, riders=(*turn.riders, job))
                return True
        return False


JOBS_SHARE = 0.5  # of the line's time, for all jobs but stops
JOBS_SAVED_S = (
    0.5  # of line time can be saved up: a start with its read-backs needs about a third of a second
)
PARAMETERS_SHARE = 0.25  # for reads and settings of parameters alone, of the same time
PARAMETERS_SAVED_S = 0.1  # a few transactions


class BandwidthShare:
    """A bucket of line time that fills by a share; what is used while nobody else wants the line is owed too.

    No more is owed than can be saved up, so that a quiet night on the line costs nobody the morning.
    """

    def __init__(self, share: float, saved_s: float) -> None:
        self._share = share
        self._ahead_s = saved_s / share  # so long before it is paid for, it may be used
        self._paid_s = -inf  # when everything used so far is paid for

    def has_room(self, now_s: float) -> bool:
        """Return whether there is something left of what was saved up."""
        return self._paid_s - now_s < self._ahead_s

    def spend(self, took_s: float, now_s: float) -> None:
        """Take over that so much of the line was used until now."""
        paid_s = max(self._paid_s, now_s) + took_s / self._share
        self._paid_s = min(paid_s, now_s + 2 * self._ahead_s)


class BandwidthShares:
    """Which jobs may go before a poll that is due; stops, their repeats and read-backs always may."""

    def __init__(self) -> None:
        self._jobs = BandwidthShare(JOBS_SHARE, JOBS_SAVED_S)
        self._parameters = BandwidthShare(PARAMETERS_SHARE, PARAMETERS_SAVED_S)

    def last_lane(self, now_s: float) -> Priority:
        """Return the last of the lanes that may."""
        if not self._jobs.has_room(now_s):
            return Priority.FOLLOW_UP
        return Priority.PARAMETERS if self._parameters.has_room(now_s) else Priority.READ_BACK

    def spend(self, lane: Priority, took_s: float, now_s: float) -> None:
        """Take over what a job has used of the line."""
        if lane > Priority.FOLLOW_UP:
            self._jobs.spend(took_s, now_s)
        if lane is Priority.PARAMETERS:
            self._parameters.spend(took_s, now_s)
