"""What is asked of a line: polls that come again and again, and jobs that are done once.

What the plan hands out, and what it makes of the outcome.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import inf

from gateway.line.rtu.forms import Alternate
from gateway.line.rtu.outcome import Outcome
from gateway.modbus.adu import BROADCAST
from gateway.modbus.pdu import Request


class Priority(enum.IntEnum):
    """The order in which waiting jobs are served: the lowest first; polls come after all lanes.

    The two lanes of stops go before everything; of the others none keeps a later one waiting for ever, nor
    jobs the polls of a full line.
    """

    STOP = 0  # the first frames of stops
    FOLLOW_UP = 1  # repeats and read-backs of stops
    COMMAND = 2  # what makes motors move
    READ_BACK = 3  # whether they did, and who a starter is
    PARAMETERS = 4  # reads and settings on demand, and what we look after of our own accord: what can wait


@dataclass(frozen=True, slots=True)
class Poll:
    """A request that is repeated for ever."""

    key: str  # unique on the line
    unit: int  # 1..247
    request: Request
    every_s: float  # 0 = as often as the line allows
    response_time_s: float  # the starter's longest time from the request's end to the reply's first byte
    response_floor_s: float | None = None  # what was learnt may shorten that down to this; None = not at all
    deadline_s: float | None = None  # its unit's watchdog: the longest time unheard; None or 0: none
    group: str = ""  # whose values it reads, for those who read its figures
    is_urgent: bool = False  # an answer that says something else than the one before is told at once
    # Other reads that say the same as one of this unit; called on the line's loop.
    alternates_of: Callable[[Request], tuple[Alternate, ...]] = field(default=lambda _: (), compare=False)


@dataclass(frozen=True, slots=True)
class Job:
    """A request that is sent once; `finish` is called exactly once, on the line's loop."""

    unit: int
    request: Request
    response_time_s: float
    lane: Priority
    finish: Callable[[Outcome], None]
    until_s: float = inf  # on the line's clock: never sent later than this

    @property
    def must_not_act_late(self) -> bool:
        """Whether it may do harm when it arrives after its answer was due: every write but a stop."""
        return self.lane is not Priority.STOP and self.request.is_write and self.unit != BROADCAST


@dataclass(frozen=True, slots=True)
class Slot:
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
    def lane(self) -> Priority | None:
        """Return the job's lane; None for a poll."""
        return None if self.job is None else self.job.lane

    @property
    def is_stop(self) -> bool:
        """Return whether this stops a motor: a stop's frame, first or repeated."""
        return self.lane is Priority.STOP or (self.lane is Priority.FOLLOW_UP and self.request.is_write)

    def without(self, job: Job) -> Slot | None:
        """Return what is left when a job is taken back; None when it was the only one."""
        left = tuple(each for each in self.jobs if each is not job)
        return replace(self, job=left[0], riders=left[1:]) if left else None


@dataclass(frozen=True, slots=True)
class Verdict:
    """What an outcome means beyond its own turn."""

    is_final: bool  # False: the request is repeated, or its poll is gone; nobody is told
    is_answering: bool | None = None  # the unit's new state when that has just changed
