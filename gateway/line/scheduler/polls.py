"""The table of polls: when each is due, by its period, its unit's state and the overload factor."""

from __future__ import annotations

import random
from math import inf
from typing import Any

from gateway.line.rtu.transaction import Outcome, Silent
from gateway.line.scheduler.line_time import (
    FREE_PERIOD_S,
    EdfQueue,
    LineTimeBudget,
    by_deadline,
    overload_factor,
)
from gateway.line.scheduler.requests import Poll, Slot
from gateway.line.scheduler.units import SILENT_AFTER, ScheduledPoll, Unit, Visit

# Of the line's time, for all silent units together: with the listening for a late reply that follows each
# silence, and is not counted here, that makes a twentieth at most.
OFFLINE_SHARE = 0.035
OFFLINE_BURST_S = 0.7  # of line time may be saved up: some six probes
ASKED_AFTER = 0.5  # of the time that is left to a watchdog: the rest is for the queue and one lost reply

_LONGEST_SLOT_S = 5.0  # what takes longer is a machine that was suspended, not a line that was busy
_FIRST_COST_S = 0.1  # of a poll that has none yet, for that bound; what is longer is learnt in a few rounds
_PATIENCE_S = 1.0  # of a unit with a poll that is due, at least, before it goes first
_AVERAGED_OVER_S = 10.0  # so far back goes the share of jobs and offline units
_WORST_OVER_S = 60.0  # the longest time that a watchdog was left is that of the last so many seconds


class PollTable:
    """Queues the polls of units that answer, at most once missed; of silent ones the units."""

    def __init__(self, chance: random.Random) -> None:
        self.stretch = 1.0  # the factor by which all periods are stretched; 1 while the line keeps them
        self.watchdogs: EdfQueue[Unit] = EdfQueue()  # those that have to be asked, by when they act
        self._answering: EdfQueue[ScheduledPoll] = EdfQueue()
        self._suspect: EdfQueue[ScheduledPoll] = EdfQueue()
        self._silent: EdfQueue[Unit] = EdfQueue()
        self._visits: EdfQueue[Visit] = EdfQueue()  # by the unit's latest request
        self._polls: dict[str, ScheduledPoll] = {}
        self._units: dict[int, Unit] = {}
        self._load = self._others = 0.0  # shares of the line's time: of the queued polls, of all else
        self._noted_s = -inf
        self._offline = LineTimeBudget(OFFLINE_SHARE, OFFLINE_BURST_S)
        self._chance = chance
        self._is_after_miss = False
        self._left: list[tuple[float, int, float]] = []  # of a watchdog's time, of which unit, when; falling

    def begin(self, now_s: float) -> None:
        """Begin on an opened port: overdue polls are due now, and each unit's state is news again."""
        for unit in self._units.values():
            unit.is_online = None
            if unit.polls and not unit.is_silent:
                self.watchdogs.put(unit, now_s, now_s + (unit.limit_s or inf))
                for each in unit.polls:
                    if not now_s < each.deadline_s < inf:
                        self._set_load(each, 0.0, each.every_s)
                        self._put(each, now_s, now_s)

    def add(self, poll: Poll, now_s: float) -> None:
        """Repeat a request from now on; ValueError when its key is taken."""
        if poll.key in self._polls:
            raise ValueError(f"there is a poll {poll.key!r} already")
        unit = self.unit(poll.unit)
        entry = self._polls[poll.key] = ScheduledPoll(poll=poll, unit=unit, every_s=poll.every_s)
        unit.polls.append(entry)
        self.set_deadline(poll.unit, unit.limit_s if poll.deadline_s is None else poll.deadline_s)
        if not unit.is_silent:
            self._put(entry, now_s, now_s)
        elif unit.queue is None:
            self._silent.put(unit, now_s, now_s)

    def remove(self, key: str) -> None:
        """End a poll; KeyError when there is no such poll."""
        entry = self._polls.pop(key)
        entry.leave()
        self._set_load(entry, 0.0, entry.every_s)
        entry.unit.polls.remove(entry)
        if not entry.unit.polls:
            entry.unit.leave()

    def set_every(self, key: str, every_s: float, now_s: float) -> None:
        """Change a poll's period; a shorter one takes effect at once. KeyError when there is no such poll."""
        entry = self._polls[key]
        self._set_load(entry, entry.cost_s, every_s)
        if entry.queue is not None:
            deadline_s = min(entry.deadline_s, now_s + (every_s or FREE_PERIOD_S) * self.stretch)
            self._put(entry, min(entry.release_s, now_s + every_s), deadline_s)

    def expedite(self, key: str, now_s: float) -> None:
        """Make a poll due now, or the probe of a unit that does not answer; KeyError when there is none."""
        entry = self._polls[key]
        if entry.unit.is_silent:
            self._silent.put(entry.unit, min(entry.unit.release_s, now_s), now_s)
        elif entry.queue is None:
            entry.deadline_s = now_s  # once more after the one under way
        elif entry.deadline_s > now_s:
            self._put(entry, now_s, now_s)

    def expedite_all(self, now_s: float) -> None:
        """Make all polls due now, and the probes of silent units: nothing could be received till now."""
        self._offline.room_at_s = -inf
        for key in self._polls:
            self.expedite(key, now_s)

    def set_deadline(self, number: int, limit_s: float | None) -> None:
        """Reach a unit within its watchdog's time from now on; None or 0 when it has none."""
        unit = self.unit(number)
        unit.limit_s = limit_s or 0.0
        if unit.reached_s > -inf:
            self._watch(unit, unit.reached_s)
        elif unit.queue is self.watchdogs:
            self.watchdogs.put(unit, unit.release_s, unit.release_s + (unit.limit_s or inf))

    def note_late(self, number: int, now_s: float) -> None:
        """Record that a reply of a unit came too late: it is there, and its probe need not wait for long."""
        unit = self.unit(number)
        unit.note_late(now_s)
        if unit.queue is self._silent:
            release_s = min(unit.release_s, now_s + unit.pause_s(now_s))
            self._silent.put(unit, release_s, release_s)

    def forget(self, number: int) -> None:
        """Know nothing of a unit any more, whose polls are removed; one that has polls stays."""
        if not self.unit(number).polls:
            del self._units[number]

    def statistics(self, now_s: float) -> dict[str, Any]:
        """Return the factor of the periods, what one slot of each poll takes, and how watchdogs are served.

        That is what they need of the line, and the worst share lately: 1 and more is missed.
        """
        load = 0.0
        for unit in self._units.values():
            asked_s = ASKED_AFTER * unit.limit_s
            periods_s = [(each.every_s or FREE_PERIOD_S) * self.stretch for each in unit.polls]
            if asked_s and unit.reached_s > -inf and min(periods_s, default=0.0) > asked_s:
                load += unit.polls[0].cost_s / asked_s
        self._left = [each for each in self._left if each[2] > now_s - _WORST_OVER_S]
        share, worst, _ = self._left[0] if self._left else (0.0, 0, now_s)
        return {
            "stretch": round(self.stretch, 3),
            "sweep_s": float(sum(each.cost_s for each in self._polls.values())),
            "watchdogs": {"load": round(load, 4), "longest_share": round(share, 4), "unit": worst},
        }

    def unit(self, number: int) -> Unit:
        """Return a unit, a new one when nothing was known of it."""
        return self._units.get(number) or self._units.setdefault(number, Unit(number=number))

    def entry_of(self, poll: Poll | None) -> ScheduledPoll | None:
        """Return the entry of a poll; None when it was removed, or another has its key."""
        entry = None if poll is None else self._polls.get(poll.key)
        return entry if entry is not None and entry.poll is poll else None

    def first(self, now_s: float) -> ScheduledPoll | None:
        """Return the poll that is next; after a miss those of units that answer come first."""
        answering = self._of_left_out(now_s) if now_s >= self._visits.released_s else None
        answering = answering or self._answering.first(now_s)
        if answering is not None and self._is_after_miss:
            return answering
        suspect = self._suspect.first(now_s) if self._suspect.things else None
        while suspect is None and self._silent.things and (unit := self._silent.first(now_s)) is not None:
            room_at_s = self._offline.room_at_s
            if now_s >= room_at_s or unit.is_fading(now_s):
                return unit.polls[0]
            self._silent.put(unit, room_at_s, room_at_s)
        return suspect or answering

    def _of_left_out(self, now_s: float) -> ScheduledPoll | None:
        """Return the next poll of the unit that was left for longest, when that is too long.

        Polls go by due time, and those of a full line that begins are all due: without this a unit would have
        all of its polls in a row, and none until all others had theirs.
        """
        while (visit := self._visits.first(now_s)) is not None:
            polls = visit.unit.polls
            waiting = [each for each in polls if each.queue is self._answering and each.release_s <= now_s]
            if waiting:
                return min(waiting, key=by_deadline)
            visit.leave()  # until its next answer
        return None

    def next_s(self) -> float:
        """Return when `first` or a watchdog has a poll; a little early at times, never late."""
        return min(
            self._answering.next_s(), self._suspect.next_s(), self._silent.next_s(), self.watchdogs.next_s()
        )

    def take(self, entry: ScheduledPoll, now_s: float) -> Slot:
        """Give the line to a poll; `record` must follow."""
        poll, since_s = entry.poll, min(max(entry.release_s, entry.deadline_s), now_s)
        entry.leave()
        entry.deadline_s = inf
        again, entry.is_repetition = entry.is_repetition, False
        return Slot(poll.unit, poll.request, poll.response_time_s, since_s, poll, is_repetition=again)

    def put_back(self, slot: Slot, entry: ScheduledPoll) -> None:
        """Have a poll wait again, before all others."""
        entry.is_repetition = slot.is_repetition
        if not entry.unit.is_silent:
            self._put(entry, slot.since_s, -inf)

    def record(
        self,
        slot: Slot,
        entry: ScheduledPoll | None,
        outcome: Outcome,
        *,
        sent_s: float,
        now_s: float,
        is_repeated: bool,
        is_sure: bool,
    ) -> bool | None:
        """Record the outcome of a slot, and plan on; return whether its unit is online when that is new.

        `entry` is that of the slot's poll; None for jobs, and for a poll that was removed.
        """
        unit = self.unit(slot.unit) if entry is None else entry.unit
        before, took_s = unit.misses, min(now_s - sent_s, _LONGEST_SLOT_S)
        was_silent = before >= SILENT_AFTER
        self._note_time(0.0 if entry is not None and not was_silent else took_s, now_s)
        is_answer = unit.note(outcome, now_s) if is_sure else None
        self._is_after_miss = is_answer is False
        if unit.misses != before:
            self._regroup(unit, now_s, was_silent=was_silent)
        is_done = entry is not None and not is_repeated
        # An answer restarts the unit's watchdog; how near it came to acting is recorded for the statistics.
        if is_answer:
            if unit.limit_s and unit.reached_s > -inf:
                left = ((sent_s - unit.reached_s) / unit.limit_s, unit.number, sent_s)
                while self._left and self._left[-1] < left:
                    self._left.pop()
                self._left.append(left)
            unit.reached_s = sent_s
            if unit.limit_s or unit.queue is not None:
                self._watch(unit, sent_s)
        elif is_done or (is_answer is False and not was_silent):
            self._watch(unit, now_s)
        # The line time for offline units is limited; the first misses of a unit are not charged to it.
        if was_silent and slot.poll is not None and not is_answer and not unit.is_fading(now_s):
            self._offline.spend(took_s, now_s)
        if entry is not None and is_done and unit.misses < SILENT_AFTER:
            self._plan(entry, slot.since_s, sent_s, now_s, 0.0 if isinstance(outcome, Silent) else took_s)
        # Fairness: a unit left for half a sweep past its due time goes before all others.
        if is_answer and unit.polls:
            patience_s = max(len(self._units) * unit.polls[0].cost_s / 2, _PATIENCE_S)
            due_s = min(map(by_deadline, unit.polls))
            self._visits.put(unit.visit, max(sent_s, due_s) + patience_s, sent_s)
        return unit.news()

    def _regroup(self, unit: Unit, now_s: float, *, was_silent: bool) -> None:
        """Queue a unit's polls as its state demands; when it is back, the other silent ones may be, too."""
        for each in unit.polls:
            if unit.is_silent:
                each.leave()
                each.release_s = each.deadline_s = inf
                self._set_load(each, 0.0, each.every_s)
            elif was_silent:
                self._put(each, now_s, now_s)
            elif each.queue is not None:
                self._put(each, each.release_s, each.deadline_s)
        if unit.is_silent:
            unit.reached_s = -inf
        elif was_silent:
            for other in self._silent.things[:]:
                self._silent.put(other, min(other.release_s, now_s), now_s)

    def _plan(self, entry: ScheduledPoll, due_s: float, sent_s: float, now_s: float, took_s: float) -> None:
        """Keep a poll's rhythm; its phase is left to chance at its first answer, also after a silence."""
        is_expedited = entry.deadline_s < inf and entry.queue is None
        period_s = (entry.every_s or FREE_PERIOD_S) * self.stretch
        since_s = due_s if self.stretch == 1.0 else sent_s
        if took_s:
            if not entry.cost_s and entry.every_s and self.stretch == 1.0:
                period_s *= self._chance.random()
            # Twice as much as the last time at most: not what a process that stood still makes of it.
            self._set_load(entry, min(took_s, 2 * (entry.cost_s or _FIRST_COST_S)), entry.every_s)
        deadline_s = now_s if is_expedited else max(since_s + period_s, now_s)
        self._put(entry, min(max(since_s + entry.every_s, now_s), deadline_s), deadline_s)

    def _watch(self, unit: Unit, asked_s: float) -> None:
        """Plan when a unit is asked for its watchdog, or as a silent one, after a request then.

        Any answered request has reached its unit. Half of its watchdog's time may pass then; after a lost
        reply half of what is left, and others go first: many that lose their supply would hold them up.
        """
        if unit.is_silent and unit.polls:
            release_s = asked_s + unit.pause_s(asked_s) * self._chance.uniform(0.9, 1.1)
            self._silent.put(unit, release_s, release_s)
        elif unit.limit_s and unit.polls and unit.reached_s > -inf:
            acts_s = unit.reached_s + unit.limit_s
            release_s = asked_s + ASKED_AFTER * (acts_s - asked_s)
            self.watchdogs.put(unit, release_s, acts_s + unit.misses * unit.limit_s)
        else:
            unit.leave()

    def _note_time(self, others_s: float, now_s: float) -> None:
        """Note that time has passed, of which jobs and silent units took `others_s`."""
        passed_s = now_s - self._noted_s
        if passed_s > 0.0:
            weight = min(passed_s / _AVERAGED_OVER_S, 1.0)
            self._others += weight * (min(others_s / passed_s, 1.0) - self._others)
        self._noted_s = now_s
        self.stretch = overload_factor(self._load, others=self._others)

    def _set_load(self, entry: ScheduledPoll, cost_s: float, every_s: float) -> None:
        """Note what a poll costs of the line's time, 0 while it is not asked, and how often it is asked."""
        self._load += cost_s / (every_s or FREE_PERIOD_S) - entry.cost_s / (entry.every_s or FREE_PERIOD_S)
        entry.cost_s, entry.every_s = cost_s, every_s

    def _put(self, entry: ScheduledPoll, release_s: float, deadline_s: float) -> None:
        (self._suspect if entry.unit.misses else self._answering).put(entry, release_s, deadline_s)
