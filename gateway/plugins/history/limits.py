"""The time to wait before a motor may be started: starts in the hour, pauses, cooling.

The thermal model is one exponential: while the motor stands, its level falls as `level * exp(-t / tau)`,
where 0 is cold. `tau` is learnt from levels that were seen to fall; before that it is what the starter is set
to (SSW900 C5.9.7.7). Where neither is known nothing is estimated. A start needs room for its own heating: as
much as the worst of the last starts has added, and `START_HEATING` of the trip level before one was seen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import Annotated

from pydantic import Field

HOUR_S = 3600.0
START_HEATING = 0.3  # of the trip level: ours; a start at class 10 takes about that
LEARNT = 5  # falls and starts that count
LEAST_FALL = 0.1  # of the level, and
LEAST_FALL_S = 60.0  # so long, before a time constant is taken from it: the level is a whole number
LEAST_LEVEL = 0.05  # of the trip level: below that a step of 1 % says nothing
TAU_S = (30.0, 30 * 86400.0)  # what a motor's can be


def starts_left(per_hour: int | None, starts_s: Sequence[float], *, now_s: float) -> int | None:
    """Return how many starts the present hour still allows; None where their number is not limited."""
    if per_hour is None:
        return None
    return max(per_hour - sum(1 for start_s in starts_s if start_s > now_s - HOUR_S), 0)


def pause_left_s(
    starts_s: Sequence[float],
    *,
    standing_since_s: float | None,
    now_s: float,
    per_hour: int | None = None,
    after_stop_s: float = 0.0,
    between_starts_s: float = 0.0,
) -> float:
    """Return after what time a start would be allowed, if the motor stood still from now on.

    It must stand for `after_stop_s`, and `between_starts_s` lie between two starts. `starts_s` are in order,
    the latest at the end; `standing_since_s` is None while the motor moves.
    """
    waits_s = [(now_s if standing_since_s is None else standing_since_s) + after_stop_s - now_s]
    waits_s += [start_s + between_starts_s - now_s for start_s in starts_s[-1:]]
    if per_hour and starts_left(per_hour, starts_s, now_s=now_s) == 0:
        waits_s.append(starts_s[-per_hour] + HOUR_S - now_s)
    return max(0.0, *waits_s)


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


@dataclass(frozen=True, slots=True)
class Learnt:
    """The last time constants of a motor's cooling, and the heatings of its last starts."""

    taus_s: tuple[Positive, ...] = ()
    heatings: tuple[Positive, ...] = ()

    def with_more(self, taus_s: Sequence[float] = (), heatings: Sequence[float] = ()) -> Learnt:
        """Return this with what was learnt later."""
        return Learnt((*self.taus_s, *taus_s)[-LEARNT:], (*self.heatings, *heatings)[-LEARNT:])


NOTHING = Learnt()


@dataclass(slots=True)
class ThermalModel:
    """Learns how one motor heats and cools; levels are in the starter's unit, times on the steady clock."""

    trip_level: float  # at which the starter trips
    set_tau_s: float | None = None  # what the starter is set to
    learnt: Learnt = NOTHING
    _level: float | None = None
    _level_s: float = 0.0  # when it was read
    _fall: tuple[float, float] | None = None  # where the present fall began: time, level
    _before_start: float | None = None  # the level before the present start
    _is_started: bool = False  # it has ended: the next level shows what it has added

    @property
    def tau_s(self) -> float | None:
        """Return the time constant of cooling; None while it is not known."""
        return median(self.learnt.taus_s) if self.learnt.taus_s else self.set_tau_s

    @property
    def restart_level(self) -> float:
        """Return from which level on a start has room for its heating."""
        heating = max(self.learnt.heatings, default=START_HEATING * self.trip_level)
        return max(self.trip_level - heating, LEAST_LEVEL * self.trip_level)

    def note_level(self, level: float, *, at_s: float, is_standing: bool) -> None:
        """Record a level that was just read, and whether the motor stands."""
        fall, before, self._level = self._fall, self._level, level
        self._level_s = at_s
        if self._is_started:
            self._note_heating(level)
        if (
            not is_standing
            or level < LEAST_LEVEL * self.trip_level
            or (before is not None and level > before)
        ):
            self._fall = None
            return
        if fall is None:
            self._fall = (at_s, level)
            return
        began_s, high = fall
        if level <= high * (1 - LEAST_FALL) and at_s - began_s >= LEAST_FALL_S:
            tau_s = (at_s - began_s) / math.log(high / level)
            if TAU_S[0] <= tau_s <= TAU_S[1]:
                self.learnt = self.learnt.with_more(taus_s=[tau_s])
            self._fall = (at_s, level)

    def note_start(self) -> None:
        """Record that a start begins."""
        self._before_start, self._is_started = self._level, False

    def note_started(self) -> None:
        """Record that it has ended at full voltage."""
        self._is_started = self._before_start is not None

    def forget(self) -> None:
        """Record that the starter was not seen for a while: what has happened to the level is not known."""
        self._level = self._fall = self._before_start = None
        self._is_started = False

    def restart_in_s(self, now_s: float) -> float | None:
        """Return the estimated time until a motor at rest is cool enough; None where that is not known."""
        if self._level is None:
            return None
        if self._level <= self.restart_level:
            return 0.0
        tau_s = self.tau_s
        if tau_s is None:
            return None
        return max(tau_s * math.log(self._level / self.restart_level) - (now_s - self._level_s), 0.0)

    def _note_heating(self, level: float) -> None:
        before, self._before_start, self._is_started = self._before_start, None, False
        if before is not None and level > before:
            self.learnt = self.learnt.with_more(heatings=[level - before])
