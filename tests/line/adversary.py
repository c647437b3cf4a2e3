"""The worst that can happen to one poll: all others are due, or are asked for at once, when that harms most.

Its own first answer is quick, all others come as late as the line waits for them.
"""

from __future__ import annotations

import itertools
import random
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import ceil, inf

from gateway.line.capacity.forecast import Forecast
from gateway.line.rtu.timeouts import ALLOWANCE_S
from gateway.line.scheduler.requests import Poll, Slot
from gateway.modbus.timing import LineTiming
from tests.line.ideal_line import IdealLine, cost_s

HURRY_S = 5.0
EARLY = (0.0, 0.06, 0.13, 0.19, 0.25, 0.31)  # of its wait: so long before its end all others are asked for


@dataclass(frozen=True)
class OldestSeen:
    """The oldest that the victim's values got, and by how much any value got older than foretold."""

    age_s: float
    excess_s: float


@dataclass(frozen=True)
class Circumstances:
    """What the line is like when the victim is asked for."""

    was_busy: bool  # a while ago all periods were shorter
    is_idle: bool  # nothing is under way
    is_in_phase: bool  # the others were asked for so that all of them are due just before it is due again


@dataclass(frozen=True)
class _Tried:
    due_s: float  # the victim for the second time
    asked_s: float
    gap_s: float  # between its answers
    excess_s: float


def worst_of(
    victim: Poll, polls: list[Poll], timing: LineTiming, prospect: Forecast, seed: int
) -> OldestSeen:
    """Look for the oldest that the values of one poll get."""
    tried = []
    for each in itertools.starmap(Circumstances, itertools.product((False, True), repeat=3)):
        calm = _Trial(victim, polls, timing).run(prospect, each, random.Random(seed))
        moments_s = (calm.due_s, calm.asked_s)
        if not victim.every_s:
            moments_s = tuple(calm.asked_s - early * calm.gap_s for early in EARLY)
        storms = (
            _Trial(victim, polls, timing, storm_s=at_s).run(prospect, each, random.Random(seed))
            for at_s in moments_s
        )
        tried += [calm, *storms]
    return OldestSeen(max(each.gap_s for each in tried), max(each.excess_s for each in tried))


class _Trial:
    """One line, from its start until the victim was answered twice."""

    def __init__(self, victim: Poll, polls: list[Poll], timing: LineTiming, *, storm_s: float = inf) -> None:
        self._victim = victim
        self._others = [poll for poll in polls if poll.key != victim.key]
        self._late_s = {poll.key: cost_s(poll, timing, allowance_s=ALLOWANCE_S) for poll in polls}
        self._quick_s = cost_s(replace(victim, response_time_s=0.0), timing)
        self._is_quick = False
        self._storm_s = inf
        self._planned_storm_s = storm_s
        self._line = IdealLine(polls, self._took_s)

    def run(self, prospect: Forecast, circumstances: Circumstances, chance: random.Random) -> _Tried:
        line, key = self._line, self._victim.key
        self._prepare(circumstances, chance)
        line.plan.hasten(key, line.now_s)
        due_s = line.now_s + self._period_s(self._victim)
        self._is_quick = True
        line.run_until_answered(key)
        self._is_quick = False
        self._meet_storm()
        line.run_until_answered(key)
        asked_s = line.now_s - self._late_s[key]
        gap_s = line.gaps_s[key][-1]
        line.run(line.now_s + 2 * gap_s)
        ages_s = {each.poll.key: each.age_s for each in prospect.polls}
        excess_s = max(max(gaps) - ages_s[each] for each, gaps in line.gaps_s.items() if gaps)
        return _Tried(due_s, asked_s, gap_s, excess_s)

    def _prepare(self, circumstances: Circumstances, chance: random.Random) -> None:
        line = self._line
        if circumstances.was_busy:
            for share in (5, 1):
                for poll in line.polls:
                    line.plan.set_every(poll.key, poll.every_s / share, line.now_s)
                line.run(line.now_s + HURRY_S)
        line.run(line.now_s + chance.uniform(10.0, 30.0))
        line.gaps_s.clear()
        if circumstances.is_in_phase:
            began_s = line.now_s + max(map(self._period_s, self._others))
            for at_s, poll in sorted(self._phases(began_s), key=lambda each: each[0]):
                line.run(at_s)
                line.plan.hasten(poll.key, line.now_s)
            line.run(began_s)
        if circumstances.is_idle:
            for _ in line.polls:  # an over-full line never is
                if line.step(line.now_s) is None:
                    break

    def _phases(self, began_s: float) -> Iterator[tuple[float, Poll]]:
        due_s = began_s + self._period_s(self._victim) - 1e-6
        for poll in self._others:
            period_s = self._period_s(poll)
            if poll.every_s and poll.every_s != self._victim.every_s:
                yield due_s - ceil((due_s - began_s) / period_s) * period_s, poll

    def _period_s(self, poll: Poll) -> float:
        return poll.every_s * self._line.plan.stretch

    def _meet_storm(self) -> None:
        """Have the longest request under way when the storm comes, unless another one is."""
        self._storm_s = self._planned_storm_s
        if self._storm_s == inf:
            return
        longest = max(self._others, key=lambda poll: self._late_s[poll.key])
        line, before = self._line, len(self._line.gaps_s[self._victim.key])
        until_s = self._storm_s - self._late_s[longest.key] / 2
        while line.now_s < until_s and len(line.gaps_s[self._victim.key]) == before:
            line.step(until_s)
        if self._storm_s < inf and len(line.gaps_s[self._victim.key]) == before:
            line.plan.hasten(longest.key, line.now_s)

    def _took_s(self, turn: Slot) -> float:
        """Let all others be asked for while the last request before the storm's moment is under way."""
        assert turn.poll is not None
        is_quick = self._is_quick and turn.poll.key == self._victim.key
        took_s = self._quick_s if is_quick else self._late_s[turn.poll.key]
        now_s = self._line.now_s
        if is_quick and not self._victim.every_s:  # it goes first: so the others become due right after it
            self._hasten_others(now_s)
        if now_s < self._storm_s <= now_s + took_s + 1e-9:
            self._storm_s = inf
            self._hasten_others(now_s)
        return took_s

    def _hasten_others(self, now_s: float) -> None:
        for other in self._others:
            self._line.plan.hasten(other.key, now_s)
