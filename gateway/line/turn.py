"""What the plan hands out, and what it makes of the outcome."""

from __future__ import annotations

from dataclasses import dataclass

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

    @property
    def is_stop(self) -> bool:
        """Return whether this stops a motor."""
        return self.job is not None and self.job.lane is Lane.STOP


@dataclass(frozen=True, slots=True)
class Verdict:
    """What an outcome means beyond its own turn."""

    is_final: bool  # False: the request is repeated, or its poll is gone; nobody is told
    is_answering: bool | None = None  # the unit's new state when that has just changed
