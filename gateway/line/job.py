"""What is asked of a line: polls that come again and again, and jobs that are done once."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import Any

from gateway.line.outcome import Outcome
from gateway.modbus.adu import BROADCAST
from gateway.modbus.pdu import Request

# Reads that together say what another does, by replies of other lengths, and what makes its value of theirs.
Alternate = tuple[tuple[Request, ...], Callable[[Any], Any]]


class Lane(enum.IntEnum):
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
    alternates: tuple[Alternate, ...] = field(default=(), compare=False)
    # Those of any other read of this unit; called on the line's loop.
    alternates_of: Callable[[Request], tuple[Alternate, ...]] = field(default=lambda _: (), compare=False)
    life: Request | None = None  # a short read that only shows whether the unit answers
    # Takes from a value what needs two equal readings while the line is disturbed; None: nothing does.
    decisive: Callable[[Any], Any] | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True)
class Job:
    """A request that is sent once; `finish` is called exactly once, on the line's loop."""

    unit: int
    request: Request
    response_time_s: float
    lane: Lane
    finish: Callable[[Outcome], None]
    until_s: float = inf  # on the line's clock: never sent later than this

    @property
    def must_not_act_late(self) -> bool:
        """Whether it may do harm when it arrives after its answer was due: every write but a stop."""
        return self.lane is not Lane.STOP and self.request.is_write and self.unit != BROADCAST
