"""Which request has the line next: `Scheduler.pick` has the precedence; the caller says what time it is.

- A poll is due a period after it was due before, so that it keeps its rhythm. When polls ask for more than
  jobs and offline units leave, all periods are stretched by one factor, and count from when a poll was sent:
  the order of a round stays, however the factor changes. While others are due it goes by due time, so each
  of them goes first once at most; on an idle line it may go after its own period, however stretched. A poll
  without a period has one of 5 s in this, and may always go.
- The unit that was left for longest goes before that order, once half a sweep has passed since a poll of it
  was due. The polls of a line that begins are all due: so they come one from each unit, again and again.
- While polls are due, jobs get half of the line's time, background jobs a quarter, and what was saved up.
- A watchdog's unit is asked when half of its time has passed; what can go before it is the request on the
  wire, units with an earlier deadline, and one other request for each eight of those. Stops come on top:
  their first frames go at once, their repeats and read-backs take as many requests as watchdogs, at most.
- Silent units get 3.5 % of the line's time, and never two requests in a row while another unit is due.
"""

from __future__ import annotations

import random
from bisect import insort, insort_left
from collections.abc import Iterable
from math import inf
from operator import attrgetter

from gateway.line.rtu.transaction import Garbled, Outcome, Silent
from gateway.line.scheduler.line_time import JOBS_BURST_S, JOBS_SHARE, LineTimeBudget
from gateway.line.scheduler.polls import PollTable
from gateway.line.scheduler.requests import Job, Poll, Priority, Slot, Verdict

IN_ROW = 8  # requests for stops, and for watchdogs, before something else that is due goes
BACKGROUND_WEIGHT = 2  # background jobs are charged so many times their line time: they get a quarter
OLDEST_EVERY = 4  # of so many jobs one is the oldest, whatever its priority
SHARED_AFTER_S = 0.1  # a stop's frame that has waited so long is sent for later stops of its unit too

_STOPS = (Priority.STOP, Priority.FOLLOW_UP)
_COMMANDS = (Priority.COMMAND, Priority.READ_BACK, Priority.PARAMETERS)
_OWN = (Priority.WATCHDOG, Priority.IDENTITY, Priority.PATROL)
_BACKGROUND = (Priority.PARAMETERS, Priority.PATROL)


class Scheduler:
    """Chooses among its two tables, `polls` and `jobs`."""

    def __init__(self, polls: Iterable[Poll] = (), *, chance: random.Random | None = None) -> None:
        self.polls = PollTable(chance or random.Random(0))
        self.jobs = JobQueue()
        self.is_for_watchdog = False  # the slot picked last
        self._follow_ups_in_row = self._watchdogs_in_row = 0
        self._gives_way = False  # to another request, after a follow-up that was not answered
        self._picked_s = -inf
        for poll in polls:
            self.polls.add(poll, -inf)

    def next_due_s(self) -> float:
        """Return when there is something to do, at times a little early; infinity when nothing is planned."""
        return min(self.jobs.next_s(), self.polls.next_s())

    def pick(self, now_s: float) -> Slot | None:
        """Return what has the line from now on, None when nothing is due; `record` must follow.

        The first that there is:

        1. A stop's frame.
        2. A repeat or read-back of a stop; after eight in a row one of 4 or 5, with eight of 3 before;
           after a read-back without an answer one of 3 to 5.
        3. The unit with the earliest watchdog deadline of those that are due, or were not asked since the
           port was opened, those that have just missed after all others; one without a known watchdog
           after commands and questions for watchdogs, in their share; after eight in a row 4 or 5 once.
        4. A job, when no poll is due or the jobs' share of line time is not used up: commands by priority,
           every fourth the oldest, then the gateway's own questions by priority.
        5. A poll of the unit that was left for longest, when half a sweep has passed since one was due; one
           by due time, one that is repeated first. After a miss those of units that answer, otherwise those
           of units that do not.
        """
        self._picked_s, self.is_for_watchdog = now_s, False
        jobs, watchdogs = self.jobs if self.jobs.waiting else None, self.polls.watchdogs
        # Stops, and their repeats as long as they leave the others a slot now and then.
        may_follow_up = self._follow_ups_in_row < IN_ROW and not self._gives_way
        slot = jobs.pop(*(_STOPS if may_follow_up else _STOPS[:1])) if jobs else None
        if slot is not None:
            return slot
        if may_follow_up:
            self._follow_ups_in_row = 0
        # Where no watchdog is due, or too many in a row were, jobs share the line with the polls.
        unit = watchdogs.first(now_s) if watchdogs.things else None
        if unit is None or self._watchdogs_in_row >= IN_ROW:
            entry = self.polls.first(now_s)
            if jobs and (entry is None or now_s >= jobs.budget.room_at_s):
                slot = jobs.pop(*_COMMANDS) or jobs.pop(*_OWN)
            if slot is None and entry is not None:
                slot = self.polls.take(entry, now_s)
        # A unit without a known watchdog, not asked since the port was opened: commands come first.
        elif jobs and unit.deadline_s == inf and now_s >= jobs.budget.room_at_s:
            slot = jobs.pop(*_COMMANDS) or jobs.pop(Priority.WATCHDOG)
        if slot is None and unit is not None:
            self.is_for_watchdog = True
            slot = self.polls.take(unit.polls[0], now_s)
        return jobs.pop(Priority.FOLLOW_UP) if slot is None and jobs else slot

    def record(
        self,
        slot: Slot,
        outcome: Outcome,
        now_s: float,
        *,
        is_open: bool = False,
        is_given_up: bool = False,
    ) -> Verdict:
        """Record the outcome of a slot that was picked, and plan on.

        An answer is open when it was another request's, which went before or instead of the slot's own: that
        one follows. A slot that its jobs have given up is not sent again.
        """
        # A read-back of a stop without an answer lets another slot pass before the next one.
        self._gives_way = self._gives_way and slot.lane is Priority.STOP
        if slot.lane is Priority.FOLLOW_UP:
            self._follow_ups_in_row += 1
            is_lost = isinstance(outcome, Silent | Garbled) and outcome.is_sent
            self._gives_way = is_lost and not slot.is_stop
        elif self.is_for_watchdog:
            self._watchdogs_in_row += 1
        elif slot.lane is not Priority.STOP:
            self._follow_ups_in_row = self._watchdogs_in_row = 0
        # A poll that was removed meanwhile is neither repeated nor published.
        entry = self.polls.entry_of(slot.poll)
        is_known = entry is not None or slot.poll is None
        is_retried = isinstance(outcome, Garbled) and _is_retried(slot, outcome)
        is_repeated = is_known and not is_given_up and (is_open or is_retried)
        if slot.jobs:
            self.jobs.charge(slot, now_s - self._picked_s, now_s)
        is_online = self.polls.record(
            slot,
            entry,
            outcome,
            sent_s=self._picked_s,
            now_s=now_s,
            is_repeated=is_repeated,
            is_sure=is_open or not is_repeated,
        )
        if is_repeated:
            again = slot._replace(is_repetition=slot.is_repetition or not is_open)
            self.jobs.put_back(again) if entry is None else self.polls.put_back(again, entry)
        return Verdict(is_known and not is_repeated, is_online)


def _is_retried(slot: Slot, outcome: Garbled) -> bool:
    """Return whether a read is sent once more, as its reply was corrupted; the line repeats no write."""
    return outcome.is_sent and not slot.is_repetition and not slot.request.is_write


class JobQueue:
    """The slots that wait: by priority, those of one priority as they were submitted."""

    def __init__(self) -> None:
        self.budget = LineTimeBudget(JOBS_SHARE, JOBS_BURST_S)  # what they may take from polls that are due
        self.waiting: list[Slot] = []
        self._commands = 0  # taken out

    def submit(self, job: Job, now_s: float) -> None:
        """Queue a job behind the others of its priority.

        A stop joins a frame of its unit that has waited for long and leaves later than the stop came: a group
        that is stopped again and again costs the line one frame each, not many.
        """
        for place, slot in enumerate(self.waiting) if job.lane is Priority.STOP else ():
            is_same = (slot.lane, slot.unit, slot.request) == (job.lane, job.unit, job.request)
            if is_same and now_s - slot.since_s > SHARED_AFTER_S:
                self.waiting[place] = slot._replace(jobs=(*slot.jobs, job))
                return
        slot = Slot(job.unit, job.request, job.response_time_s, now_s, lane=job.lane, jobs=(job,))
        insort(self.waiting, slot, key=attrgetter("lane"))

    def withdraw(self, job: Job) -> bool:
        """Take a job back; False when it is not waiting (any more)."""
        for place, slot in enumerate(self.waiting):
            if job in slot.jobs:
                left = slot.without(job)
                self.waiting[place : place + 1] = [] if left is None else [left]
                return True
        return False

    def clear(self) -> tuple[Job, ...]:
        """Return all waiting jobs and forget them."""
        slots, self.waiting = self.waiting, []
        return tuple(job for slot in slots for job in slot.jobs)

    def put_back(self, slot: Slot) -> None:
        """Return a slot to the head of its priority."""
        insort_left(self.waiting, slot, key=attrgetter("lane"))

    def has_stop(self) -> bool:
        """Return whether a stop's frame, repeat or read-back waits."""
        return bool(self.waiting) and self.waiting[0].lane in _STOPS

    def next_s(self) -> float:
        """Return from when on there is a job to send."""
        return -inf if self.waiting else inf

    def pop(self, *lanes: Priority) -> Slot | None:
        """Take out the next job of these priorities; of all but stops now and then the oldest."""
        ready = [slot for slot in self.waiting if slot.lane in lanes]
        if not ready:
            return None
        self._commands += lanes == _COMMANDS
        is_oldest = lanes == _COMMANDS and self._commands % OLDEST_EVERY == 0
        slot = min(ready, key=attrgetter("since_s")) if is_oldest else ready[0]
        self.waiting.remove(slot)
        return slot

    def charge(self, slot: Slot, took_s: float, now_s: float) -> None:
        """Charge what a slot has used of the line to the jobs' share; stops are free."""
        if slot.lane in _COMMANDS + _OWN:
            weight = BACKGROUND_WEIGHT if slot.lane in _BACKGROUND else 1
            self.budget.spend(weight * took_s, now_s)
