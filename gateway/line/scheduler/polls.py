"""The polls of all units, and what their units' health does to them."""

from __future__ import annotations

import itertools
import random
from math import inf

from gateway.line.rtu.outcome import Garbled, Outcome
from gateway.line.scheduler.backoff import BACK_OFF_CEILING_S, back_off_s
from gateway.line.scheduler.edf_queue import NOWHERE
from gateway.line.scheduler.load import LoadControl
from gateway.line.scheduler.poll_queue import PollQueue
from gateway.line.scheduler.requests import Poll
from gateway.line.scheduler.units import Evidence, ScheduledPoll, Unit, UnitState
from gateway.line.scheduler.watchdogs import Watchdogs

GIVING = 0.05  # of its period a poll on a busy line gives way, so that rhythms fall into gaps of their own
PATIENCE_S = 5.0  # after the last sign of life, before a unit is asked ever less often: it may be noise
NEIGHBOUR_S = 5.0  # units that went silent within so long probably did for one reason


class PollTable:
    """Keeps each poll's due time; a unit that does not answer is asked by its first poll only, the probe."""

    def __init__(self, *, seed: int, jitter: float) -> None:
        places = itertools.count(1)
        self.stretch = LoadControl()
        self.rota = PollQueue(places, self.stretch)
        self.watchdogs = Watchdogs(places)
        self._chance = random.Random(seed)
        self._jitter = jitter
        self._entries: dict[str, ScheduledPoll] = {}
        self._units: dict[int, Unit] = {}
        self._asked: tuple[Poll, ...] | None = None
        self._was_busy = False

    def begin(self, now_s: float) -> None:
        """Begin on an opened port: overdue polls are due now, once, each unit's first before the others."""
        self.rota.begin(now_s)
        self.stretch.recount(self._entries.values())
        for unit in self._units.values():
            unit.told = None
        for entry in self._entries.values():
            entry.is_first = entry is entry.unit.entries[0]
            if entry.unit.is_asked(entry):
                self._put(entry, max(entry.release_s, now_s))

    def add(self, poll: Poll, now_s: float) -> None:
        """Take a poll; ValueError when its key is taken."""
        if poll.key in self._entries:
            raise ValueError(f"there is a poll {poll.key!r} already")
        unit = self.unit(poll.unit)
        entry = ScheduledPoll(poll=poll, unit=unit, every_s=poll.every_s)
        unit.entries.append(entry)
        self._entries[poll.key] = entry
        self._asked = None
        if poll.deadline_s is not None:
            self.watchdogs.set(poll.unit, poll.deadline_s)
        self._count(entry)
        if unit.is_asked(entry):
            self._put(entry, now_s)

    def remove(self, key: str) -> None:
        """Forget a poll; KeyError when there is no such poll."""
        entry = self._entries.pop(key)
        unit = entry.unit
        was_probe = unit.entries[0] is entry
        unit.entries.remove(entry)
        self._asked = None
        self.rota.drop(entry)
        self.stretch.count(entry, is_counted=False)
        if unit.is_held and was_probe and unit.entries:
            unit.entries[0].release_s = entry.release_s
            self.rota.put(unit.entries[0])

    def set_every(self, key: str, every_s: float, now_s: float) -> None:
        """Change a poll's period; a shorter one takes effect at once. KeyError when there is no such poll."""
        entry = self._entries[key]
        entry.every_s = every_s
        self._count(entry)
        if entry.is_out or entry.unit.is_held:
            return
        deadline_s = entry.deadline_s
        self._put(entry, min(entry.release_s, now_s + every_s * self.stretch.factor))
        if every_s and deadline_s < entry.deadline_s:
            entry.deadline_s = deadline_s
            self.rota.put(entry)

    def hasten(self, key: str, now_s: float) -> None:
        """Make a poll due now, or the probe of a unit that does not answer; KeyError as above."""
        entry = self._entries[key]
        self._hasten(entry.unit.entries[0] if entry.unit.is_held else entry, now_s)

    def unit(self, number: int) -> Unit:
        """Return a unit, a new one when nothing was known of it."""
        unit = self._units.get(number)
        if unit is None:
            unit = self._units[number] = Unit(number=number)
        return unit

    def forget(self, number: int) -> None:
        """Let a unit without polls be as if it had never been asked; one with polls stays."""
        unit = self._units.get(number)
        if unit is not None and not unit.entries:
            del self._units[number]
            self.watchdogs.set(number, None)
            self.watchdogs.rest(number)

    def probe_of(self, number: int) -> Poll | None:
        """Return a unit's first poll; None when it has none."""
        unit = self._units.get(number)
        return unit.entries[0].poll if unit is not None and unit.entries else None

    def state_of(self, number: int) -> UnitState:
        """Return what is known of a unit."""
        return self._units[number].health.state if number in self._units else UnitState.NEW

    def entry_of(self, poll: Poll | None) -> ScheduledPoll | None:
        """Return the entry of a poll; None when it was removed, or another has its key."""
        entry = None if poll is None else self._entries.get(poll.key)
        return entry if entry is not None and entry.poll is poll else None

    def asked(self) -> tuple[Poll, ...]:
        """Return the polls that are asked at present."""
        if self._asked is None:
            self._asked = tuple(each.poll for each in self._entries.values() if each.unit.is_asked(each))
        return self._asked

    def watchdog_load(self) -> float:
        """Return the share of the line's time for watchdogs which the polls' own rhythm does not keep."""
        load = 0.0
        for number, kept_s in self.watchdogs.kept_every_s().items():
            entries = self.unit(number).entries
            if entries and all(not e.every_s or e.every_s * self.stretch.factor > kept_s for e in entries):
                load += entries[0].cost_s / kept_s
        return load

    def barking(self, now_s: float) -> ScheduledPoll | None:
        """Return the first poll of the unit that has to be asked for its watchdog, by deadline."""
        while (number := self.watchdogs.first(now_s)) is not None:
            unit = self.unit(number)
            if unit.entries:
                return unit.entries[0]
            self.watchdogs.rest(number)
        return None

    def take(self, entry: ScheduledPoll, now_s: float, *, for_watchdog: bool) -> None:
        """Take out the poll that is asked now, in its rhythm or only because its unit's watchdog needs it."""
        gives_s = GIVING * entry.every_s if self._was_busy and self.stretch.factor == 1.0 else 0.0
        entry.rhythm_s = min(entry.release_s + gives_s, now_s)
        if for_watchdog is not entry.is_watchdogs:
            entry.is_watchdogs = for_watchdog
            self._count(entry)
        self.rota.take(entry, now_s)
        entry.was_hastened, entry.was_first = entry.is_hastened, entry.is_first
        entry.is_hastened = entry.is_first = False

    def put_back(self, entry: ScheduledPoll, until_s: float) -> None:
        """Let a poll wait until its unit may be asked."""
        entry.release_s = entry.soonest_s = until_s
        entry.deadline_s = max(entry.deadline_s, until_s)
        entry.is_hastened, entry.is_first = entry.is_hastened or entry.was_hastened, entry.was_first
        self.rota.put(entry)

    def plan_next(self, entry: ScheduledPoll, now_s: float) -> None:
        """Keep a poll's rhythm after its turn, or as much of it as the line has time for."""
        unit = entry.unit
        if self.stretch.is_busy is not self._was_busy:
            self._reorder()
        if unit.is_held:
            if entry is unit.entries[0] and entry.place == NOWHERE:
                self._put(entry, now_s + unit.pace_s)
        elif entry.is_hastened:
            self._put(entry, now_s)
        else:
            due_s = max(entry.rhythm_s + entry.every_s * self.stretch.factor, now_s)
            self._put(entry, due_s)
            entry.soonest_s = min(max(entry.rhythm_s + entry.every_s, now_s), due_s)

    def learn(self, unit: Unit, outcome: Outcome, *, poll: Poll | None, since_s: float, now_s: float) -> None:
        """Move a unit's health on after a turn that began at `since_s` and held the line until now."""
        was_silent, was_suspect = unit.is_silent, unit.is_suspect
        sign = unit.health.take(outcome, now_s)
        self.rota.is_after_silence = sign is Evidence.MISS
        if sign is Evidence.ANSWER:
            unit.misses = 0
            unit.patient_until_s = now_s + PATIENCE_S
            self.watchdogs.heard(unit.number, since_s)
            self._release(unit, poll, now_s)
            if was_silent:
                self._wake_neighbours(unit, now_s)
        else:
            self.watchdogs.tried(unit.number, now_s)
            if unit.is_held and poll is not None and since_s >= unit.patient_until_s:
                self.rota.budget.spend(now_s - since_s, now_s)
        if sign is Evidence.MISS:
            unit.misses += 0 if unit.health.is_forgiven(now_s) else 1
            if not was_suspect and not was_silent:
                unit.missed_s = now_s
            unit.miss_cost_s = now_s - since_s
            if isinstance(outcome, Garbled):
                unit.probes, unit.patient_until_s = 0, now_s + PATIENCE_S
            self._miss(unit, now_s, is_probe=poll is not None or not was_silent)
        if unit.is_suspect is not was_suspect and not unit.is_held:
            for entry in unit.entries:
                if not entry.is_out:
                    self.rota.put(entry)

    def _miss(self, unit: Unit, now_s: float, *, is_probe: bool) -> None:
        if unit.health.is_forgiven(now_s):
            self._hold(unit, now_s + unit.pace_s)
        elif unit.is_silent and is_probe:
            # It may well hear us, and only its replies be lost: its watchdog is not to act.
            ceiling_s = min(BACK_OFF_CEILING_S, self.watchdogs.retry_s(unit.number))
            pause_s = back_off_s(
                unit.pace_s, unit.probes, jitter=self._jitter, chance=self._chance, ceiling_s=ceiling_s
            )
            if now_s >= unit.patient_until_s:
                unit.probes += 1
            self._hold(unit, now_s + pause_s)

    def _hold(self, unit: Unit, probe_due_s: float) -> None:
        """Ask only the unit's first poll, and that at its time."""
        if not unit.is_held:
            unit.is_held, self._asked = True, None
        self.watchdogs.rest(unit.number)
        for entry in unit.entries:
            self.rota.drop(entry)
            entry.release_s, entry.is_hastened = inf, False
            self._count(entry)
        if unit.entries:
            self._put(unit.entries[0], probe_due_s)

    def _release(self, unit: Unit, poll: Poll | None, now_s: float) -> None:
        """Ask everything of a unit that answers again; the poll that was answered keeps its own time."""
        unit.probes = 0
        if not unit.is_held:
            return
        unit.is_held, self._asked = False, None
        for entry in unit.entries:
            self._count(entry)
            if entry.poll is not poll:
                self._put(entry, min(entry.release_s, now_s))

    def _wake_neighbours(self, unit: Unit, now_s: float) -> None:
        """Ask those next that went silent at about the same time, once."""
        near_s = max(NEIGHBOUR_S, 2 * unit.pace_s)
        for other in self._units.values():
            is_near = other.is_silent and abs(other.missed_s - unit.missed_s) <= near_s
            if is_near and other.entries and other.woken_s < now_s - NEIGHBOUR_S:
                other.woken_s = now_s
                self._hasten(other.entries[0], now_s)

    def _hasten(self, entry: ScheduledPoll, now_s: float) -> None:
        is_next = entry.release_s <= now_s and (entry.is_hastened or not entry.unit.is_held)
        entry.is_hastened = True
        if entry.is_out or is_next:
            return
        entry.release_s = entry.soonest_s = now_s  # its rhythm begins anew
        entry.deadline_s = min(entry.deadline_s, self._deadline_s(entry))
        self.rota.put(entry)

    def _put(self, entry: ScheduledPoll, due_s: float) -> None:
        """Let a poll wait for its time."""
        entry.release_s = entry.soonest_s = due_s
        entry.deadline_s = self._deadline_s(entry)
        self.rota.put(entry)

    def _deadline_s(self, entry: ScheduledPoll) -> float:
        """Return by when a poll is to be asked: a period after it is due; on a busy line when it is due.

        By due time each of the others goes first once at most, whenever and however often it is hastened.
        """
        if entry.is_first:
            return entry.release_s
        if not entry.every_s:
            return inf
        return entry.release_s if self._was_busy else entry.release_s + entry.every_s

    def _reorder(self) -> None:
        """Put the polls in the order of a line that has become busy, or has time to spare again."""
        self._was_busy = self.stretch.is_busy
        for entry in self._entries.values():
            if entry.every_s and not entry.is_out and not entry.unit.is_held:
                entry.deadline_s = self._deadline_s(entry)
                self.rota.put(entry)

    def _count(self, entry: ScheduledPoll) -> None:
        self.stretch.count(entry, is_counted=not entry.unit.is_held and not entry.is_watchdogs)
