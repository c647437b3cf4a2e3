"""The table of polls: when each is due, by its period, its unit's state and the overload factor."""

from __future__ import annotations

import random
from bisect import insort
from math import inf
from operator import attrgetter

from gateway.line.rtu.outcome import Outcome, Silent
from gateway.line.scheduler.line_time import (
    FREE_PERIOD_S,
    OFFLINE_BURST_S,
    OFFLINE_SHARE,
    LineTimeBudget,
    overload_factor,
)
from gateway.line.scheduler.requests import Poll, Slot
from gateway.line.scheduler.units import ASKED_AFTER, SILENT_AFTER, ScheduledPoll, Unit
from gateway.modbus.adu import BROADCAST

_LONGEST_SLOT_S = 5.0  # what takes longer is a machine that was suspended, not a line that was busy
_STRETCHED_EVERY_S = 1.0  # the factor is computed so often
_AVERAGED_OVER_S = 10.0  # so far back goes the share of jobs and offline units
_WORST_OVER_S = 60.0  # the longest time that a watchdog was left is that of the last so many seconds


class PollTable:
    """Keeps the polls by due time; of a silent unit only the first poll, its probe, is asked."""

    def __init__(self, chance: random.Random) -> None:
        self.stretch = 1.0  # the factor by which all periods are stretched; 1 while the line keeps them
        self._stretched_s = -inf
        self._others = self._others_s = 0.0  # share of jobs and offline units; their time since then
        self._offline = LineTimeBudget(OFFLINE_SHARE, OFFLINE_BURST_S)
        self._polls: dict[str, ScheduledPoll] = {}
        self._order: list[ScheduledPoll] = []  # the same by deadline
        self._units: dict[int, Unit] = {}
        self._chance = chance
        self._is_after_miss = False
        self._left: list[tuple[float, int, float]] = []  # shares of their watchdogs' time, units, when

    def begin(self, now_s: float) -> None:
        """Begin on an opened port: any watchdog may be running, and each unit's state is news again."""
        for unit in self._units.values():
            unit.is_online = None
            if not unit.is_silent:
                unit.due_s = now_s

    def add(self, poll: Poll) -> None:
        """Repeat a request from now on; ValueError when its key is taken."""
        if poll.key in self._polls:
            raise ValueError(f"there is a poll {poll.key!r} already")
        unit = self.unit(poll.unit)
        entry = self._polls[poll.key] = ScheduledPoll(poll=poll, unit=unit, every_s=poll.every_s)
        unit.polls.append(entry)
        insort(self._order, entry, key=attrgetter("deadline_s"))
        if poll.deadline_s is not None:
            self.set_deadline(poll.unit, poll.deadline_s)

    def remove(self, key: str) -> None:
        """Ask no more; KeyError when there is no such poll."""
        entry = self._polls.pop(key)
        self._order.remove(entry)
        entry.unit.polls.remove(entry)

    def set_every(self, key: str, every_s: float, now_s: float) -> None:
        """Change a poll's period; a shorter one takes effect at once. KeyError when there is no such poll."""
        entry = self._polls[key]
        entry.every_s = every_s
        if entry.release_s < inf:
            deadline_s = min(entry.deadline_s, now_s + (every_s or FREE_PERIOD_S) * self.stretch)
            self._put(entry, min(entry.release_s, now_s + every_s), deadline_s)

    def expedite(self, key: str, now_s: float) -> None:
        """Make a poll due now, also one that is under way, and a silent unit's probe. KeyError as above."""
        entry = self._polls[key]
        self._put(entry, min(entry.release_s, now_s), min(entry.deadline_s, now_s))
        if entry.unit.is_silent:
            entry.unit.due_s = min(entry.unit.due_s, now_s)

    def expedite_all(self, now_s: float) -> None:
        """Make all polls due now, and the probes of silent units: nothing could be received till now."""
        self._offline.fill()
        for key in self._polls:
            self.expedite(key, now_s)

    def set_deadline(self, number: int, limit_s: float | None) -> None:
        """Reach a unit within its watchdog's time from now on; None or 0 when it has none."""
        unit = self.unit(number)
        unit.limit_s = limit_s or 0.0
        if unit.reached_s > -inf:
            unit.watch(unit.reached_s)

    def forget(self, number: int) -> None:
        """Know nothing of a unit any more, whose polls are removed; one that has polls stays."""
        if not self.unit(number).polls:
            del self._units[number]

    def asked(self) -> tuple[Poll, ...]:
        """Return the polls that are asked at present: of a silent unit only the probe."""
        polls = self._polls.values()
        return tuple([each.poll for each in polls if not each.unit.is_silent or each is each.unit.polls[0]])

    def watchdog_statistics(self, now_s: float) -> dict[str, float | int]:
        """Return what the units' watchdogs need of the line, and the worst lately: 1 and more is missed."""
        load = 0.0
        for unit in self._units.values():
            asked_s = ASKED_AFTER * unit.limit_s
            periods_s = [(each.every_s or FREE_PERIOD_S) * self.stretch for each in unit.polls]
            if asked_s and unit.reached_s > -inf and min(periods_s, default=0.0) > asked_s:
                load += unit.polls[0].cost_s / asked_s
        share, worst, _ = next((each for each in self._left if each[2] > now_s - _WORST_OVER_S), (0.0, 0, 0))
        return {"load": round(load, 4), "longest_share": round(share, 4), "unit": worst}

    def unit(self, number: int) -> Unit:
        """Return a unit, a new one when nothing was known of it."""
        return self._units.get(number) or self._units.setdefault(number, Unit(number=number))

    def entry_of(self, poll: Poll | None) -> ScheduledPoll | None:
        """Return the entry of a poll; None when it was removed, or another has its key."""
        entry = None if poll is None else self._polls.get(poll.key)
        return entry if entry is not None and entry.poll is poll else None

    def urgent(self, now_s: float) -> Unit | None:
        """Return the unit that has to be asked now for its watchdog, the earliest deadline first.

        Those that have just missed come last: many that lose their supply at once would hold up the others.
        """
        units = self._units.values()
        due = [each for each in units if each.due_s <= now_s and each.polls and each.misses < SILENT_AFTER]
        return min(due, key=attrgetter("misses", "deadline_s"), default=None)

    def first(self, now_s: float) -> ScheduledPoll | None:
        """Return the poll that is next; after a miss those of units that answer come first."""
        doubtful = None
        for each in self._order:
            unit = each.unit
            if unit.misses >= SILENT_AFTER:
                if unit.due_s > now_s or not self._may_be_asked(each, now_s):
                    continue
            elif each.release_s > now_s:
                continue
            if not unit.misses or not self._is_after_miss:
                return each
            doubtful = doubtful or each
        return doubtful

    def _may_be_asked(self, entry: ScheduledPoll, now_s: float) -> bool:
        """Return whether a silent unit's poll is its probe, and there is room in the share of such units."""
        unit = entry.unit
        if not unit.is_fading(now_s):
            unit.due_s = max(unit.due_s, self._offline.room_at_s())
        return unit.due_s <= now_s and entry is unit.polls[0]

    def next_s(self) -> float:
        """Return when `first` or `urgent` has something; a little early at times, never late."""
        units_s = [each.due_s for each in self._units.values() if each.polls]
        polls_s = [each.release_s for each in self._polls.values() if each.unit.misses < SILENT_AFTER]
        return min(units_s + polls_s, default=inf)

    def take(self, entry: ScheduledPoll, now_s: float) -> Slot:
        """Reserve the line for a poll; `put_back` or `record` must follow."""
        poll, since_s = entry.poll, min(max(entry.release_s, entry.deadline_s), now_s)
        entry.release_s = inf
        again = entry.is_repetition
        return Slot(poll.unit, poll.request, poll.response_time_s, since_s, poll, is_repetition=again)

    def put_back(self, slot: Slot, until_s: float) -> None:
        """Have a poll wait again, before all others; its unit may not be asked before `until_s`."""
        entry = self.entry_of(slot.poll)
        if entry is not None:
            entry.unit.due_s = max(entry.unit.due_s, until_s)
            entry.release_s, entry.deadline_s = max(slot.since_s, until_s), -inf
            self._order.remove(entry)
            self._order.insert(0, entry)
            entry.is_repetition = slot.is_repetition

    def record(
        self, slot: Slot, outcome: Outcome, *, sent_s: float, now_s: float, is_repeated: bool, is_sure: bool
    ) -> bool | None:
        """Learn what became of a slot, and plan on; return whether its unit is online when that is new."""
        unit, entry = self.unit(slot.unit), self.entry_of(slot.poll)
        was_silent, took_s = unit.is_silent, min(now_s - sent_s, _LONGEST_SLOT_S)
        self._note_time(0.0 if entry is not None and not was_silent else took_s, now_s)
        if slot.unit == BROADCAST:
            return None
        is_answer = unit.note(outcome, now_s) if is_sure else None
        self._is_after_miss = is_answer is False
        if entry is not None and not is_repeated:
            if not isinstance(outcome, Silent):
                entry.cost_s = took_s
            self._plan_next(entry, slot.since_s, sent_s, now_s)
        if is_answer:
            self._note_reached(unit, sent_s)
            for each in self._units.values() if was_silent else ():
                if each.is_silent:
                    each.due_s = now_s  # it may be back, too
        elif is_answer is False and (entry is not None or not was_silent):
            self._note_miss(unit, now_s)
        if was_silent and slot.poll is not None and not is_answer and not unit.is_fading(now_s):
            self._offline.spend(took_s, now_s)
        return unit.news()

    def _note_time(self, others_s: float, now_s: float) -> None:
        """Note that others took so much of the line's time; now and then compute the factor."""
        self._others_s += others_s
        passed_s = now_s - self._stretched_s
        if passed_s >= _STRETCHED_EVERY_S:
            weight = min(passed_s / _AVERAGED_OVER_S, 1.0)
            self._others += weight * (min(self._others_s / passed_s, 1.0) - self._others)
            self._others_s, self._stretched_s = 0.0, now_s
            asked = [each for each in self._polls.values() if each.unit.misses < SILENT_AFTER]
            load = sum([each.cost_s / (each.every_s or FREE_PERIOD_S) for each in asked])
            self.stretch = overload_factor(load, others=self._others)

    def _note_reached(self, unit: Unit, sent_s: float) -> None:
        if unit.limit_s and unit.reached_s > -inf:
            left = ((sent_s - unit.reached_s) / unit.limit_s, unit.number, sent_s)
            self._left = [each for each in self._left if each > left and each[2] > sent_s - _WORST_OVER_S]
            self._left.append(left)
        unit.reached_s = sent_s
        unit.watch(sent_s)

    def _note_miss(self, unit: Unit, now_s: float) -> None:
        """Have the polls of a unit in doubt go first; all of a silent one are overdue when it is back."""
        for each in unit.polls:
            self._put(each, -inf if unit.is_silent else each.release_s, -inf)
        unit.watch(now_s)
        if unit.is_silent:
            unit.reached_s = -inf
            unit.due_s = now_s + unit.pause_s(now_s) * self._chance.uniform(0.9, 1.1)

    def _plan_next(self, entry: ScheduledPoll, since_s: float, sent_s: float, now_s: float) -> None:
        """Keep a poll's rhythm; one that is a whole period late begins another, in a phase left to chance."""
        entry.is_repetition = False
        if entry.release_s < inf:
            return  # it was expedited meanwhile
        period_s = (entry.every_s or FREE_PERIOD_S) * self.stretch
        if self.stretch > 1.0 or not entry.every_s:
            since_s = sent_s
        if since_s + period_s < now_s:
            since_s = sent_s - period_s * (1.0 - self._chance.random())
        self._put(entry, max(since_s + entry.every_s, now_s), since_s + period_s)

    def _put(self, entry: ScheduledPoll, release_s: float, deadline_s: float) -> None:
        entry.release_s = release_s
        if deadline_s != entry.deadline_s:
            entry.deadline_s = deadline_s
            self._order.remove(entry)
            insort(self._order, entry, key=attrgetter("deadline_s"))
