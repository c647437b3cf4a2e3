"""The units of a line: whether they answer, and their polls.

| misses in a row | state | asked | reported |
|---|---|---|---|
| 0 | NEW, ANSWERING after the first answer | all polls | online |
| 1 | SUSPECT | all polls, after a unit that answers | as before |
| 2, 3 | SILENT | the first poll, the probe, with back-off | as before |
| 4 and more | SILENT | the same | offline |

A reply that comes too late, of a unit that has answered in time lately, makes three misses or more two, and
for a few seconds there are three at most.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from math import inf

from gateway.line.rtu.transaction import Answered, Outcome, Refused, Silent
from gateway.line.scheduler.line_time import Queued
from gateway.line.scheduler.requests import Poll

SILENT_AFTER = 2  # misses: where 5 % of the replies are lost this happens every few minutes,
OFFLINE_AFTER = 4  # and this hardly ever
PROBE_MIN_S = 1.0  # between two probes of a silent unit at least
PROBE_MAX_S = 16.0  # and at most
LATE_FOR_S = 30.0  # a unit that answers only too late for longer counts as silent
FADING_S = 5.0  # after anything was received: its silence may be noise, and is not counted as offline


class UnitState(enum.StrEnum):
    """The known facts of a unit."""

    NEW = "new"
    ANSWERING = "answering"
    SUSPECT = "suspect"
    SILENT = "silent"


@dataclass(slots=True, eq=False, kw_only=True)
class ScheduledPoll(Queued):
    """A poll; due at its deadline, a stretched period after the one before, and never before its release."""

    poll: Poll
    unit: Unit
    every_s: float
    cost_s: float = 0.0  # of the line's time, the last time; 0 until it is answered
    is_repetition: bool = False  # its reply was corrupted: it is due once more


@dataclass(slots=True, eq=False, kw_only=True)
class Visit(Queued):
    """A unit's place among those that are left without a request; due when it has been left for long."""

    unit: Unit


@dataclass(slots=True, eq=False, kw_only=True)
class Unit(Queued):
    """One unit; due when its first poll is asked for its watchdog, or as the probe of a silent one."""

    number: int
    polls: list[ScheduledPoll] = field(default_factory=list)
    visit: Visit = field(init=False)
    misses: int = 0  # in a row
    was_received: bool = False  # anything ever, corrupted or not
    is_online: bool | None = None  # as last reported
    received_s: float = -inf  # when that was last; before it, when it was asked first
    answered_s: float = -inf  # the latest reply in time
    late_s: float = -inf  # the latest reply that was too late
    forgiven_until_s: float = -inf  # it restarts: until then it is not taken for offline
    limit_s: float = 0.0  # its watchdog's time; 0: none is known
    reached_s: float = -inf  # before the latest answered request was sent; -inf: it is silent

    def __post_init__(self) -> None:
        self.visit = Visit(unit=self)

    @property
    def is_silent(self) -> bool:
        """Return whether only its probe is asked."""
        return self.misses >= SILENT_AFTER

    @property
    def state(self) -> UnitState:
        """Return the state that follows from the misses."""
        if self.misses:
            return UnitState.SILENT if self.is_silent else UnitState.SUSPECT
        return UnitState.ANSWERING if self.was_received else UnitState.NEW

    def note(self, outcome: Outcome, now_s: float) -> bool | None:
        """Return True for an answer, False for a miss, None when an outcome says nothing of the unit."""
        if isinstance(outcome, Silent) and not outcome.is_sent:
            return None
        self.was_received |= not isinstance(outcome, Silent)
        if not isinstance(outcome, Silent) or self.received_s == -inf:
            self.received_s = now_s
        if isinstance(outcome, Answered | Refused):
            self.misses = 0
            self.answered_s = now_s
            return True
        self.misses += 1
        if now_s < self.forgiven_until_s:
            self.misses = min(self.misses, SILENT_AFTER)
        elif self.is_online and now_s < min(self.answered_s + LATE_FOR_S, self.late_s + FADING_S):
            self.misses = min(self.misses, OFFLINE_AFTER - 1)
        return False

    def note_late(self, now_s: float) -> None:
        """Record that a reply came too late: for a while the unit is not taken for offline."""
        self.late_s = now_s
        if now_s < self.answered_s + LATE_FOR_S:
            self.received_s = now_s
            self.misses = min(self.misses, SILENT_AFTER)

    def is_late(self, now_s: float) -> bool:
        """Return whether its latest reply came too late, a short while ago."""
        return max(self.answered_s, now_s - LATE_FOR_S) < self.late_s

    def expect_silence(self, until_s: float) -> None:
        """Take a unit that does not answer until then for a restarting one, not for an offline one."""
        self.forgiven_until_s = max(self.forgiven_until_s, until_s)

    def news(self) -> bool | None:
        """Return whether the unit is online when that differs from the last report; None for nothing new."""
        before = self.is_online
        if self.misses >= OFFLINE_AFTER:
            self.is_online = False
        elif not self.misses and self.was_received:
            self.is_online = True
        return None if self.is_online is before else self.is_online

    def is_fading(self, now_s: float) -> bool:
        """Return whether something was received from a unit only just now, corrupted or not."""
        return self.was_received and now_s < self.received_s + FADING_S

    def pause_s(self, now_s: float) -> float:
        """Return how long a silent unit is left: as long as it has been silent, within bounds.

        It may receive what is sent, and only its replies be lost: then its watchdog is not to act, even where
        that is shorter than its period.
        """
        every_s = self.polls[0].every_s if self.polls else 0.0
        least_s = max(min(every_s, self.limit_s / 4 or inf), PROBE_MIN_S)
        most_s = min(PROBE_MAX_S, self.limit_s / 8 or inf)
        silent_s = now_s - max(self.received_s, self.forgiven_until_s)
        return min(max(silent_s, least_s), max(most_s, least_s))
