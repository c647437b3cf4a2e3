"""The units of a line with their polls, as the plan keeps them.

Whether a unit answers: one state machine, told of each outcome.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from math import inf
from typing import assert_never

from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Refused, Silent
from gateway.line.scheduler.backoff import BACK_OFF_FLOOR_S
from gateway.line.scheduler.edf_queue import Listed
from gateway.line.scheduler.requests import Poll

_GARBLED_THAT_MISS = 2  # a single garbled reply is the line's fault more often than the unit's


class UnitState(enum.Enum):
    """What is known of a unit."""

    NEW = "new"  # never answered, never missed
    ANSWERING = "answering"
    SUSPECT = "suspect"  # missed once
    SILENT = "silent"


class Evidence(enum.Enum):
    """What an outcome says of the unit's life."""

    ANSWER = "answer"
    MISS = "miss"


TRANSITIONS = {
    (UnitState.NEW, Evidence.ANSWER): UnitState.ANSWERING,
    (UnitState.NEW, Evidence.MISS): UnitState.SUSPECT,
    (UnitState.ANSWERING, Evidence.ANSWER): UnitState.ANSWERING,
    (UnitState.ANSWERING, Evidence.MISS): UnitState.SUSPECT,
    (UnitState.SUSPECT, Evidence.ANSWER): UnitState.ANSWERING,
    (UnitState.SUSPECT, Evidence.MISS): UnitState.SILENT,
    (UnitState.SILENT, Evidence.ANSWER): UnitState.ANSWERING,
    (UnitState.SILENT, Evidence.MISS): UnitState.SILENT,
}


class UnitHealth:
    """The state of one unit, moved by outcomes."""

    def __init__(self) -> None:
        self.state = UnitState.NEW
        self._garbled_in_row = 0
        self._forgiven_until_s = float("-inf")

    def expect_silence(self, until_s: float) -> None:
        """Count no misses until then."""
        self._forgiven_until_s = max(self._forgiven_until_s, until_s)

    def is_forgiven(self, now_s: float) -> bool:
        """Return whether misses do not count now."""
        return now_s < self._forgiven_until_s

    def take(self, outcome: Outcome, now_s: float) -> Evidence | None:
        """Move on by one outcome; return what it said of the unit, None when nothing.

        A miss in a time of expected silence is returned, but does not count.
        """
        sign = self._sign_of(outcome)
        if sign is None or (sign is Evidence.MISS and self.is_forgiven(now_s)):
            return sign
        self.state = TRANSITIONS[self.state, sign]
        return sign

    def _sign_of(self, outcome: Outcome) -> Evidence | None:
        match outcome:
            case Answered() | Refused():
                self._garbled_in_row = 0
                return Evidence.ANSWER
            case Silent(is_sent=is_sent):
                self._garbled_in_row = 0
                return Evidence.MISS if is_sent else None
            case Garbled():
                self._garbled_in_row += 1
                return Evidence.MISS if self._garbled_in_row >= _GARBLED_THAT_MISS else None
            case _:
                assert_never(outcome)


# Two misses in a row let a unit be asked by its probe alone, which happens every few minutes where 5 % of the
# replies are lost. So many in a row are a unit that is lost, and not replies that are.
LOST_AFTER_MISSES = 4
GUESSED_COST_S = 0.03  # of a poll that has not been answered yet


@dataclass(slots=True, eq=False, kw_only=True)
class ScheduledPoll(Listed):
    """One poll and when it is due; `release_s` is that time, `deadline_s` when it should have been asked."""

    poll: Poll
    unit: Unit
    every_s: float
    soonest_s: float = -inf  # due without any stretching: an idle line may ask it from then on
    rhythm_s: float = -inf  # from which its next due time is counted
    is_out: bool = False  # under way, or about to be repeated
    is_hastened: bool = False  # asked for at once; or once more, while it is out
    is_repetition: bool = False
    is_first: bool = False  # of its unit, and not asked since the port was opened
    was_hastened: bool = False  # the same two before it was taken out
    was_first: bool = False
    is_watchdogs: bool = False  # asked for its unit's watchdog more often than in its own rhythm
    cost_s: float = GUESSED_COST_S  # of the line's time
    is_measured: bool = False
    is_counted: bool = False  # in what the line is asked for
    load: float = 0.0  # share of the line's time, as counted at present
    is_free: bool = False  # counted as one without a period


@dataclass(slots=True, eq=False, kw_only=True)
class Unit:
    """One unit's polls; while it is held only the first of them, the probe, is asked."""

    number: int
    health: UnitHealth = field(default_factory=UnitHealth)
    entries: list[ScheduledPoll] = field(default_factory=list)
    is_held: bool = False
    probes: int = 0  # without an answer since it went silent
    patient_until_s: float = -inf  # from the latest reply on, spoilt or not: until then it is no dead unit
    woken_s: float = -inf  # for a neighbour that answered
    missed_s: float = -inf  # the first miss of those in a row
    miss_cost_s: float = 0.0
    misses: int = 0  # in a row
    told: bool | None = None  # whether it answers, as last returned by `news`

    @property
    def is_silent(self) -> bool:
        """Return whether it has gone silent."""
        return self.health.state is UnitState.SILENT

    @property
    def is_suspect(self) -> bool:
        """Return whether it has missed once."""
        return self.health.state is UnitState.SUSPECT

    @property
    def pace_s(self) -> float:
        """Return how often it is asked, at most, while it does not answer but is not given up."""
        return max(self.entries[0].every_s if self.entries else 0.0, BACK_OFF_FLOOR_S)

    def is_asked(self, entry: ScheduledPoll) -> bool:
        """Return whether one of its polls is asked at present."""
        return not self.is_held or entry is self.entries[0]

    def news(self) -> bool | None:
        """Return whether the unit answers when that is not what was told before; None for nothing new."""
        is_answering = self.told
        if self.health.state is UnitState.ANSWERING:
            is_answering = True
        elif self.health.state is UnitState.SILENT and self.misses >= LOST_AFTER_MISSES:
            is_answering = False
        if is_answering is self.told:
            return None
        self.told = is_answering
        return is_answering
