"""The requests for a line: polls, which are periodic, and jobs, which are done once."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import NamedTuple

from gateway.line.rtu.forms import ANYONE, Forms
from gateway.line.rtu.transaction import Outcome
from gateway.modbus import Request


class Priority(enum.IntEnum):
    """The order of jobs, the lowest first."""

    STOP = 0  # the first frames of stops
    FOLLOW_UP = 1  # repeats and read-backs of stops
    COMMAND = 2  # what makes motors move
    READ_BACK = 3  # whether they did, and who a starter is
    PARAMETERS = 4  # reads and settings on demand
    # The gateway's own questions, which wait for all those:
    WATCHDOG = 5  # that of a starter which was not asked yet
    IDENTITY = 6  # who a starter is
    PATROL = 7  # parameters, diagnosis and memory that it reads by itself


@dataclass(frozen=True, slots=True)
class Poll:
    """A request that is repeated as long as the line is served."""

    key: str  # unique on the line
    unit: int  # 1..247
    request: Request
    every_s: float  # 0 = as often as the line allows
    response_time_s: float  # the starter's longest time from the request's end to the reply's first byte
    deadline_s: float | None = None  # its unit's watchdog: the longest time without a request; 0: it has none
    group: str = ""  # whose values it reads, for the statistics
    is_urgent: bool = False  # an answer that differs from the one before is published at once
    forms: Forms = field(default=ANYONE, compare=False)  # what else can be asked of this unit


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """A request that is sent once; `finish` is called exactly once, on the line's loop."""

    unit: int
    request: Request
    response_time_s: float
    lane: Priority
    finish: Callable[[Outcome], None]
    until_s: float = inf  # on the line's clock: never sent later than this

    @property
    def is_stop(self) -> bool:
        """Whether this stops a motor: a stop's frame, first or repeated."""
        return self.lane is Priority.STOP or (self.lane is Priority.FOLLOW_UP and self.request.is_write)

    @property
    def must_not_act_late(self) -> bool:
        """Whether it may do harm when it arrives after its answer was due: every write but a stop's."""
        return self.lane > Priority.FOLLOW_UP and self.request.is_write


class Slot(NamedTuple):
    """One request that the scheduler has chosen: for a poll, or for jobs."""

    unit: int
    request: Request
    response_time_s: float
    since_s: float  # when the poll was due or the first job submitted
    poll: Poll | None = None
    lane: Priority | None = None  # the jobs'
    jobs: tuple[Job, ...] = ()  # a stop's frame may be sent for several
    is_repetition: bool = False  # the reply to the first attempt was corrupted

    @property
    def until_s(self) -> float:
        """Return after what time the request is not sent any more."""
        return self.jobs[0].until_s if self.jobs else inf

    @property
    def is_stop(self) -> bool:
        """Return whether this stops a motor."""
        return bool(self.jobs) and self.jobs[0].is_stop

    def without(self, job: Job) -> Slot | None:
        """Return what is left when a job is withdrawn; None when it was the only one."""
        left = tuple(each for each in self.jobs if each is not job)
        return self._replace(jobs=left) if left else None


class Verdict(NamedTuple):
    """The meaning of an outcome beyond its own slot."""

    is_final: bool  # False: the request is sent again, or its poll was removed; nothing is published
    is_answering: bool | None = None  # the unit's new state when that has just changed
