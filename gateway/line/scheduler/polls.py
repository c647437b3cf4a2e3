"""The table of polls: when each is due, by its period, its unit's state and the overload factor."""

from __future__ import annotations

import random
from math import inf

from gateway.line.rtu.outcome import Garbled, Outcome, Silent
from gateway.line.scheduler.edf_queue import EdfQueue
from gateway.line.scheduler.line_time import (
    OFFLINE_BURST_S,
    OFFLINE_SHARE,
    LineTimeBudget,
    LoadControl,
    period_of,
)
from gateway.line.scheduler.requests import Poll, Slot
from gateway.line.scheduler.units import ScheduledPoll, Unit
from gateway.line.scheduler.watchdogs import ASKED_AFTER, Watchdogs
from gateway.modbus.adu import BROADCAST


class PollTable:
    """Keeps each poll's due time; of a silent unit only the first poll, its probe, is queued."""

    def __init__(self, chance: random.Random) -> None:
        self.watchdogs = Watchdogs()
        self._load = LoadControl()
        self._offline = LineTimeBudget(OFFLINE_SHARE, OFFLINE_BURST_S)
        self._answering: EdfQueue[ScheduledPoll] = EdfQueue()
        self._doubtful: EdfQueue[ScheduledPoll] = EdfQueue()  # of suspect and silent units
        self._polls: dict[str, ScheduledPoll] = {}
        self._units: dict[int, Unit] = {}
        self._chance = chance
        self._is_after_miss = False

    @property
    def stretch(self) -> float:
        """Return the factor by which all periods are stretched at present; 1 while the line keeps them."""
        return self._load.factor

    def begin(self, now_s: float) -> None:
        """Begin on an opened port: overdue polls are due now, and each unit's state is news again."""
        for unit in self._units.values():
            unit.is_online = None
            if unit.polls and not unit.is_silent:
                self.watchdogs.begin(unit, now_s)
            for each in unit.asked:
                if not now_s < each.deadline_s < inf:
                    self._load.set_cost(each, 0.0)
                    self._put(each, now_s)

    def add(self, poll: Poll, now_s: float) -> None:
        """Repeat a request from now on; ValueError when its key is taken."""
        if poll.key in self._polls:
            raise ValueError(f"there is a poll {poll.key!r} already")
        unit = self.unit(poll.unit)
        entry = ScheduledPoll(poll=poll, unit=unit, every_s=poll.every_s, period_s=period_of(poll.every_s))
        self._polls[poll.key] = entry
        unit.polls.append(entry)
        if poll.deadline_s is not None or unit.queue is None:
            self.watchdogs.set(unit, unit.limit_s if poll.deadline_s is None else poll.deadline_s)
        if not unit.is_silent or entry is unit.polls[0]:
            self._put(entry, now_s)

    def remove(self, key: str) -> None:
        """Ask no more; KeyError when there is no such poll."""
        entry = self._polls.pop(key)
        unit = entry.unit
        was_probe = unit.is_silent and unit.polls[0] is entry
        unit.polls.remove(entry)
        entry.leave()
        self._load.set_cost(entry, 0.0)
        if not unit.polls:
            unit.leave()
        elif was_probe:
            self._put(unit.polls[0], entry.deadline_s if entry.deadline_s < inf else -inf)  # inf: under way

    def set_every(self, key: str, every_s: float, now_s: float) -> None:
        """Change a poll's period; a shorter one takes effect at once. KeyError when there is no such poll."""
        entry = self._polls[key]
        cost_s = entry.cost_s
        self._load.set_cost(entry, 0.0)
        entry.every_s, entry.period_s = every_s, period_of(every_s)
        self._load.set_cost(entry, cost_s)
        if entry.queue is not None and not entry.unit.is_silent:
            entry.release_s = min(entry.release_s, now_s + every_s)
            entry.deadline_s = min(entry.deadline_s, now_s + entry.period_s * self.stretch)
            self._queue(entry)

    def expedite(self, key: str, now_s: float) -> None:
        """Make a poll due now, or the probe of a unit that does not answer; KeyError when there is none."""
        entry = self._polls[key]
        if entry.unit.is_silent:
            entry = entry.unit.polls[0]
        if entry.queue is None:
            entry.deadline_s = now_s  # once more after the one under way
        elif entry.deadline_s > now_s:
            self._put(entry, now_s)

    def expedite_all(self, now_s: float) -> None:
        """Make all polls due now, and the probes of silent units: nothing could be received till now."""
        self._offline.fill()
        for poll in self.asked():
            self.expedite(poll.key, now_s)

    def set_deadline(self, unit: int, limit_s: float | None) -> None:
        """Reach a unit within its watchdog's time from now on; None or 0 when it has none."""
        self.watchdogs.set(self.unit(unit), limit_s)

    def forget(self, unit: int) -> None:
        """Know nothing of a unit any more, whose polls are removed; one that has polls stays."""
        known = self._units.get(unit)
        if known is not None and not known.polls:
            known.leave()
            del self._units[unit]

    def asked(self) -> tuple[Poll, ...]:
        """Return the polls that are asked at present: of a silent unit only the probe."""
        return tuple([each.poll for unit in self._units.values() for each in unit.asked])

    def watchdog_statistics(self, now_s: float) -> dict[str, float | int]:
        """Return what the units' watchdogs need of the line, and the worst lately: 1 and more is missed."""
        load = 0.0
        for unit in self._units.values():
            asked_s = ASKED_AFTER * unit.limit_s
            if not asked_s or unit.reached_s == -inf or not unit.polls:
                continue
            if min([each.period_s for each in unit.polls]) * self.stretch > asked_s:
                load += unit.polls[0].cost_s / asked_s
        share, worst = self.watchdogs.worst(now_s)
        return {"load": round(load, 4), "longest_share": round(share, 4), "unit": worst}

    def unit(self, number: int) -> Unit:
        """Return a unit, a new one when nothing was known of it."""
        unit = self._units.get(number)
        if unit is None:
            unit = self._units[number] = Unit(number=number)
        return unit

    def entry_of(self, poll: Poll | None) -> ScheduledPoll | None:
        """Return the entry of a poll; None when it was removed, or another has its key."""
        entry = None if poll is None else self._polls.get(poll.key)
        return entry if entry is not None and entry.poll is poll else None

    def first(self, now_s: float) -> ScheduledPoll | None:
        """Return the poll that is next; after a miss those of units that answer come first."""
        answering = self._answering.first(now_s)
        if answering is not None and self._is_after_miss:
            return answering
        while (entry := self._doubtful.first(now_s)) is not None:
            unit = entry.unit
            if not unit.is_silent or unit.is_fading(now_s) or self._offline.has_room(now_s):
                return entry
            entry.release_s = self._offline.room_at_s()
            self._queue(entry)
        return answering

    def next_s(self) -> float:
        """Return when `first` or a watchdog has a poll; a little early at times, never late."""
        return min(self._answering.next_s(), self._doubtful.next_s(), self.watchdogs.next_s())

    def take(self, entry: ScheduledPoll, now_s: float) -> Slot:
        """Reserve the line for a poll; `put_back` or `record` must follow."""
        poll, since_s = entry.poll, min(max(entry.release_s, entry.deadline_s), now_s)
        entry.leave()
        entry.deadline_s = inf
        return Slot(poll.unit, poll.request, poll.response_time_s, since_s, poll=poll)

    def put_back(self, slot: Slot, until_s: float) -> None:
        """Give a reservation up; the unit may not be asked before `until_s`."""
        entry = self.entry_of(slot.poll)
        if entry is not None:
            self.watchdogs.hold(entry.unit, until_s)
            self._put(entry, max(min(slot.since_s, entry.deadline_s), until_s))

    def record(
        self,
        slot: Slot,
        entry: ScheduledPoll | None,
        outcome: Outcome,
        *,
        sent_s: float,
        took_s: float,
        now_s: float,
        is_repeated: bool,
        is_unsure: bool = False,
    ) -> bool | None:
        """Learn what became of a slot, and plan on; return whether its unit is online when that is new.

        `entry` is that of the slot's poll; None for jobs, and for a poll that was removed. What is unsure may
        be a late reply, and is no answer yet.
        """
        unit = self.unit(slot.unit) if entry is None else entry.unit
        before, was_silent = unit.misses, unit.is_silent
        is_in_rhythm = entry is not None and not was_silent
        self._load.update(others_s=0.0 if is_in_rhythm else took_s, now_s=now_s)
        if slot.unit == BROADCAST:
            return None
        is_retried = is_repeated and isinstance(outcome, Garbled)
        is_answer = None
        if is_unsure:
            unit.note_late(now_s)
        elif not is_retried:
            is_answer = unit.note(outcome, sent_s=sent_s, now_s=now_s)
        self._is_after_miss = is_answer is False
        if is_answer:
            self.watchdogs.reached(unit, sent_s)
        elif is_answer is False or (entry is not None and not is_repeated):
            self.watchdogs.missed(unit, now_s)
        if was_silent and slot.poll is not None and not is_answer and not unit.is_fading(now_s):
            self._offline.spend(took_s, now_s)
        if unit.misses != before:
            self._regroup(unit, now_s, was_silent=was_silent)
        if entry is not None and not is_repeated:
            cost_s = min(took_s, 2 * entry.cost_s or inf)  # not what a process that stood still makes of it
            self._plan_next(entry, slot, sent_s, now_s, cost_s=0.0 if isinstance(outcome, Silent) else cost_s)
        return unit.news()

    def _regroup(self, unit: Unit, now_s: float, *, was_silent: bool) -> None:
        """Queue a unit's polls as its state demands; when it is back, the other silent ones may be, too."""
        if unit.is_silent and not was_silent:
            for each in unit.polls:
                each.leave()
                each.deadline_s = inf
                self._load.set_cost(each, 0.0)
            if unit.polls:
                self._put_probe(unit, now_s)
        elif was_silent and not unit.is_silent:
            for each in unit.polls:
                self._put(each, now_s)
            for other in self._units.values():
                if other.is_silent and other.polls:
                    self.expedite(other.polls[0].poll.key, now_s)
        elif not unit.is_silent:
            for each in unit.polls:
                if each.queue is not None:
                    self._queue(each)

    def _plan_next(
        self, entry: ScheduledPoll, slot: Slot, sent_s: float, now_s: float, *, cost_s: float
    ) -> None:
        """Keep a poll's rhythm; its phase is left to chance at its first answer, also after a silence."""
        if entry.unit.is_silent:
            if entry is entry.unit.polls[0]:
                self._put_probe(entry.unit, now_s)
            return
        is_expedited = entry.deadline_s < inf and entry.queue is None
        factor = self._load.factor
        period_s = entry.period_s * factor
        if cost_s:
            if not entry.cost_s and entry.every_s and factor == 1.0:
                period_s *= self._chance.random()
            self._load.set_cost(entry, cost_s)
        since_s = slot.since_s if factor == 1.0 else sent_s
        entry.deadline_s = now_s if is_expedited else max(since_s + period_s, now_s)
        entry.release_s = min(max(since_s + entry.every_s, now_s), entry.deadline_s)
        self._queue(entry)

    def _put_probe(self, unit: Unit, now_s: float) -> None:
        self._put(unit.polls[0], now_s + unit.pause_s(now_s) * self._chance.uniform(0.9, 1.1))

    def _put(self, entry: ScheduledPoll, due_s: float) -> None:
        entry.release_s = entry.deadline_s = due_s
        self._queue(entry)

    def _queue(self, entry: ScheduledPoll) -> None:
        (self._doubtful if entry.unit.misses else self._answering).put(entry)
