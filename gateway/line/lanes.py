"""The jobs that wait, each in its lane."""

from __future__ import annotations

from collections import deque

from gateway.line.job import Job, Lane
from gateway.line.turn import Turn


class Lanes:
    """One queue for each lane."""

    def __init__(self) -> None:
        self._waiting: dict[Lane, deque[Turn]] = {lane: deque() for lane in Lane}

    def __bool__(self) -> bool:
        return any(self._waiting.values())

    def submit(self, job: Job, now_s: float) -> None:
        """Queue a job at the end of its lane."""
        turn = Turn(job.unit, job.request, job.response_time_s, now_s, job=job)
        self._waiting[job.lane].append(turn)

    def put_first(self, job: Job, turn: Turn) -> None:
        """Queue a job's turn before the others of its lane."""
        self._waiting[job.lane].appendleft(turn)

    def take(self, last: Lane) -> Turn | None:
        """Take out what is first in these lanes, from `STOP` to the last."""
        for lane, turns in self._waiting.items():
            if turns and lane <= last:
                return turns.popleft()
        return None

    def withdraw(self, job: Job) -> bool:
        """Take a job back; False when it is not waiting (any more)."""
        turns = self._waiting[job.lane]
        for turn in turns:
            if turn.job is job:
                turns.remove(turn)
                return True
        return False

    def clear(self) -> tuple[Job, ...]:
        """Return all waiting jobs and forget them."""
        jobs = tuple(turn.job for turns in self._waiting.values() for turn in turns if turn.job is not None)
        for turns in self._waiting.values():
            turns.clear()
        return jobs
