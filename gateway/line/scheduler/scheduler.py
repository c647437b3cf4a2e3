"""Which request has the line next.

1. The frames of stops.
2. Their repeats and read-backs; while watchdogs are due, for 0.2 s in a row, then up to eight of those pass.
3. A read whose reply was garbled, once.
4. Units whose watchdog needs them asked.
5. Commands, read-backs and polls, where no kind starves another.

Polls come by deadline; those of silent units ever less often. A choice costs O(log n).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from math import inf

from gateway.line.rtu.outcome import Garbled, Outcome, Silent
from gateway.line.scheduler.job_queue import BandwidthShares, JobQueue
from gateway.line.scheduler.polls import PollTable
from gateway.line.scheduler.requests import Job, Poll, Priority, Slot
from gateway.line.scheduler.requests import Verdict as Verdict
from gateway.line.scheduler.units import ScheduledPoll, UnitState

JOBS_IN_ROW = 4  # that an overdue poll lets pass; those of stops do not count
FOLLOW_UPS_IN_ROW_S = 0.2  # of line time for repeats and read-backs of stops, before a watchdog that is due
LONGEST_TURN_S = 5.0  # what takes longer is a machine that was halted, not a line that was busy
WATCHDOGS_IN_ROW = 8  # units asked for their watchdog's sake, before something else that is due has a turn

_BROADCAST = 0


class Scheduler:
    """Chooses; has no clock of its own, so every call that needs the time is given it."""

    def __init__(self, polls: Iterable[Poll] = (), *, seed: int = 0, jitter: float = 0.1) -> None:
        self._polled = PollTable(seed=seed, jitter=jitter)
        self._lanes = JobQueue()
        self._shares = BandwidthShares()
        self._again: ScheduledPoll | None = None  # its reply was garbled: it is asked again at once
        self._is_for_watchdog = False  # the turn under way
        self._jobs_in_row = 0
        self._watchdogs_in_row = 0
        self._follow_ups_s = 0.0  # of line time, in a row
        self._picked_s = self._freed_s = -inf
        for poll in polls:
            self.add_poll(poll, -inf)

    def begin(self, now_s: float) -> None:
        """Begin on an opened port: overdue polls are due now, once; each unit's state is news again."""
        self._again = None
        self._freed_s = now_s
        self._polled.begin(now_s)

    def add_poll(self, poll: Poll, now_s: float) -> None:
        """Repeat a request from now on; ValueError when its key is taken."""
        self._polled.add(poll, now_s)

    def remove_poll(self, key: str) -> None:
        """Ask no more; KeyError when there is no such poll."""
        self._polled.remove(key)
        if self._again is not None and self._again.poll.key == key:
            self._again = None

    def set_every(self, key: str, every_s: float, now_s: float) -> None:
        """Change a poll's period; a shorter one takes effect at once. KeyError when there is no such poll."""
        self._polled.set_every(key, every_s, now_s)

    def set_deadline(self, unit: int, limit_s: float | None) -> None:
        """See to it that a unit is reached within its watchdog's time; None or 0 when it has none."""
        self._polled.watchdogs.set(unit, limit_s)

    def hasten(self, key: str, now_s: float) -> None:
        """Make a poll due now, or the probe of a unit that does not answer; KeyError as above."""
        self._polled.hasten(key, now_s)

    def hasten_all(self, now_s: float) -> None:
        """Make all polls due now, and the probes of the silent: nobody could be heard till now."""
        self._polled.rota.budget.forgive(now_s)
        for poll in self._polled.asked():
            self._polled.hasten(poll.key, now_s)

    def expect_silence(self, unit: int, until_s: float) -> None:
        """Count no misses of this unit until then; only its probe is asked after a first one."""
        self._polled.unit(unit).health.expect_silence(until_s)

    def forget(self, unit: int) -> None:
        """Know nothing of a unit any more, whose polls are removed."""
        self._polled.forget(unit)

    def submit(self, job: Job, now_s: float) -> None:
        """Queue a job at the end of its lane."""
        self._lanes.submit(job, now_s)

    def withdraw(self, job: Job) -> bool:
        """Take a waiting job back; False when it is not waiting (any more)."""
        return self._lanes.withdraw(job)

    def take_jobs(self) -> tuple[Job, ...]:
        """Return all waiting jobs and forget them."""
        return self._lanes.clear()

    def polls(self) -> tuple[Poll, ...]:
        """Return the polls that are asked at present: of a held unit only the probe."""
        return self._polled.asked()

    def state_of(self, unit: int) -> UnitState:
        """Return what is known of a unit."""
        return self._polled.state_of(unit)

    @property
    def stretch(self) -> float:
        """Return the factor by which all periods are stretched at present; 1 while the line keeps them."""
        return self._polled.stretch.factor

    def watchdog_figures(self, now_s: float) -> dict[str, float | int]:
        """Return what the units' watchdogs need of the line, and the worst lately: 1 and more is missed."""
        share, unit = self._polled.watchdogs.worst(now_s)
        load = self._polled.watchdog_load()
        return {"load": round(load, 4), "longest_share": round(share, 4), "unit": unit}

    def next_due_s(self) -> float:
        """Return when there is something to do, at times a little early; infinity when nothing is planned."""
        if self._lanes:
            return -inf
        if self._again is not None:
            return self._freed_s
        return min(self._lanes.next_s(), self._polled.rota.next_s(), self._polled.watchdogs.next_s())

    def pick(self, now_s: float) -> Slot | None:
        """Return what has the line next, None when nothing is due; `record` or `put_back` must follow."""
        self._picked_s = now_s
        self._is_for_watchdog = False
        self._lanes.release(now_s)
        stop = self._lanes.take(Priority.STOP)
        if stop is not None:
            return stop
        barking = self._polled.barking(now_s)
        if barking is None or self._follow_ups_s < FOLLOW_UPS_IN_ROW_S or self._has_given_way():
            follow_up = self._lanes.take(Priority.FOLLOW_UP)
            if follow_up is not None:
                return follow_up
        if self._again is not None:
            again, self._again = self._again, None
            return _turn(again, now_s)
        turn = None
        if barking is None or self._watchdogs_in_row >= WATCHDOGS_IN_ROW:
            turn = self._pick_other(now_s)
        if turn is None and barking is not None:
            self._watchdogs_in_row += 1
            self._is_for_watchdog = True
            return self._ask(barking, now_s)
        self._watchdogs_in_row = 0
        return turn

    def put_back(self, turn: Slot, until_s: float) -> None:
        """Take back a turn that could not be asked, or not yet: what only reads then lets others pass."""
        if turn.job is not None and until_s > self._picked_s and not turn.request.is_write:
            self._lanes.hold(turn.job, turn, until_s)
        elif turn.job is not None:
            self._lanes.put_first(turn.job, turn)
        elif (entry := self._polled.entry_of(turn.poll)) is not None:
            if turn.is_repetition and until_s <= self._picked_s:
                self._again = entry
                return
            self._polled.put_back(entry, until_s)
            if until_s > self._picked_s:
                self._polled.watchdogs.bar(turn.unit, until_s)

    def probe_of(self, unit: int) -> Poll | None:
        """Return a unit's first poll; None when it has none."""
        return self._polled.probe_of(unit)

    def record(self, turn: Slot, outcome: Outcome, now_s: float, *, is_open: bool = False) -> Verdict:
        """Learn what became of a picked turn and plan on; what `is_open` is asked again at once."""
        entry = self._polled.entry_of(turn.poll)
        since_s = self._began_s(turn, entry, now_s)
        self._freed_s = now_s
        is_repeated = self._repeat_if_open(turn, entry, outcome, is_open=is_open)
        if turn.job is not None:
            self._shares.spend(turn.job.lane, now_s - since_s, now_s)
        if turn.lane is Priority.FOLLOW_UP:
            self._follow_ups_s = (0.0 if self._has_given_way() else self._follow_ups_s) + now_s - since_s
            self._watchdogs_in_row = 0
        elif turn.lane is not Priority.STOP and not self._is_for_watchdog:
            self._follow_ups_s = 0.0
        stretch = self._polled.stretch
        is_rhythmic = entry is not None and entry.is_counted
        stretch.pass_time(now_s, others_s=0.0 if is_rhythmic else now_s - since_s)
        if entry is not None and not isinstance(outcome, Silent):
            stretch.measure(entry, now_s - since_s)
        answering = None
        if turn.unit != _BROADCAST:
            unit = self._polled.unit(turn.unit)
            self._polled.learn(unit, outcome, poll=turn.poll, since_s=since_s, now_s=now_s)
            answering = unit.news()
        if entry is not None and not is_repeated:
            self._polled.plan_next(entry, now_s)
        is_final = not is_repeated and (turn.poll is None or entry is not None)
        return Verdict(is_final, answering)

    def _began_s(self, turn: Slot, entry: ScheduledPoll | None, now_s: float) -> float:
        """Return from when on a turn kept the line busy, the silence before it included."""
        due_s = self._picked_s if entry is not None and entry.unit.is_held else turn.since_s
        return max(self._freed_s, min(due_s, self._picked_s), now_s - LONGEST_TURN_S)

    def _has_given_way(self) -> bool:
        """Return whether follow-ups have let as many watchdogs pass as go in a row."""
        return self._watchdogs_in_row >= WATCHDOGS_IN_ROW

    def _pick_other(self, now_s: float) -> Slot | None:
        """Return the first job, or the first poll after so many jobs in a row or so much line time."""
        entry = self._polled.rota.first(now_s)
        if entry is None or self._jobs_in_row < JOBS_IN_ROW:
            job = self._lanes.take(
                Priority.PARAMETERS if entry is None else self._last_lane_before(entry, now_s)
            )
            if job is not None:
                self._jobs_in_row += 1
                return job
        if entry is None:
            return None
        self._jobs_in_row = 0
        return self._ask(entry, now_s)

    def _last_lane_before(self, entry: ScheduledPoll, now_s: float) -> Priority:
        """Return the last of the lanes whose jobs go before a poll that is due."""
        last = self._shares.last_lane(now_s)
        # A unit's watchdog may wait for its first poll: what we ask of our own accord can wait longer.
        return min(last, Priority.COMMAND) if entry.is_first else last

    def _ask(self, entry: ScheduledPoll, now_s: float) -> Slot:
        turn = _turn(entry, now_s)
        self._polled.take(entry, now_s, for_watchdog=self._is_for_watchdog)
        return turn

    def _repeat_if_open(
        self, turn: Slot, entry: ScheduledPoll | None, outcome: Outcome, *, is_open: bool
    ) -> bool:
        """Keep a garbled read due, once, and what is open; the line itself sends no write twice."""
        is_garbled = isinstance(outcome, Garbled) and outcome.is_sent
        is_repetition = turn.is_repetition or is_garbled
        is_repeated = is_open or (is_garbled and not turn.is_repetition and not turn.request.is_write)
        if entry is not None:
            entry.is_repetition = is_repeated and is_repetition
            self._again = entry if is_repeated else None
        elif turn.job is not None and is_repeated:
            again = replace(turn, is_repetition=is_repetition)
            self._lanes.put_first(turn.job, again)
        return is_repeated


def _turn(entry: ScheduledPoll, now_s: float) -> Slot:
    poll = entry.poll
    return Slot(
        poll.unit,
        poll.request,
        poll.response_time_s,
        min(entry.release_s, now_s),
        poll=poll,
        is_repetition=entry.is_repetition,
    )
