"""What the plan hands out, and what it makes of the outcome."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gateway.line.job import Job, Lane, Poll
from gateway.modbus.pdu import Request


@dataclass(frozen=True, slots=True)
class Turn:
    """One request that the plan has chosen; exactly one of `poll` and `job` is set."""

    unit: int
    request: Request
    response_time_s: float
    since_s: float  # when the poll was due or the job submitted
    poll: Poll | None = None
    job: Job | None = None
    is_repetition: bool = False  # the reply to the first attempt was garbled
    riders: tuple[Job, ...] = ()  # further jobs for which this one request is sent

    @property
    def jobs(self) -> tuple[Job, ...]:
        """Return the jobs that end with this turn."""
        return () if self.job is None else (self.job, *self.riders)

    @property
    def lane(self) -> Lane | None:
        """Return the job's lane; None for a poll."""
        return None if self.job is None else self.job.lane

    @property
    def is_stop(self) -> bool:
        """Return whether this stops a motor: a stop's frame, first or repeated."""
        return self.lane is Lane.STOP or (self.lane is Lane.FOLLOW_UP and self.request.is_write)

    def without(self, job: Job) -> Turn | None:
        """Return what is left when a job is taken back; None when it was the only one."""
        left = tuple(each for each in self.jobs if each is not job)
        return replace(self, job=left[0], riders=left[1:]) if left else None


@dataclass(frozen=True, slots=True)
class Verdict:
    """What an outcome means beyond its own turn."""

    is_final: bool  # False: the request is repeated, or its poll is gone; nobody is told
    is_answering: bool | None = None  # the unit's new state when that has just changed
