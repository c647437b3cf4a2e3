"""Which request has the line next.

The idea. Polls wait in a queue by due time, jobs in queues by priority; a bucket of line time settles which
of the two goes first. A unit whose watchdog needs a request goes before both, a stop before everything.
Nothing here has a clock: the caller says what time it is.

Invariants.

- A poll is due a period after it was due before, so that it keeps its rhythm. When polls ask for more than
  jobs and offline units leave, all periods are stretched by one factor, and count from when a poll was sent:
  the order of a round stays, however the factor changes. While others are due it goes by due time, so each
  of them goes first once at most; on an idle line it may go after its own period, however stretched. A poll
  without a period has one of 5 s in this, and may always go.
- While polls are due, jobs get half of the line's time, background jobs a quarter, and what was saved up.
- A watchdog's unit is asked when half of its time has passed; what can go before it is the request on the
  wire, units with an earlier deadline, and one other request for each eight of those. Stops come on top:
  their first frames go at once, their repeats and read-backs take as many requests as watchdogs, at most.
- Silent units get 3.5 % of the line's time, and never two requests in a row while another unit is due.
- A slot that was picked is a reservation: `put_back` undoes it, `record` makes it count.

`Scheduler.pick` has the precedence.
"""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import replace
from math import inf

from gateway.line.rtu.bus_faults import whole_frame
from gateway.line.rtu.outcome import Garbled, Outcome, Silent
from gateway.line.scheduler.job_queue import JobQueue
from gateway.line.scheduler.polls import PollTable
from gateway.line.scheduler.requests import Poll, Priority, Slot, Verdict
from gateway.modbus.codes import EXCEPTION_BIT

IN_ROW = 8  # requests for stops, and for watchdogs, before something else that is due goes

_LONGEST_SLOT_S = 5.0  # what takes longer is a machine that was suspended, not a line that was busy


class Scheduler:
    """Chooses among its two tables, `polls` and `jobs`."""

    def __init__(self, polls: Iterable[Poll] = (), *, chance: random.Random | None = None) -> None:
        self.polls = PollTable(chance or random.Random(0))
        self.jobs = JobQueue()
        self._retry: Slot | None = None  # a poll whose reply was corrupted, or is open: asked again at once
        self.is_for_watchdog = False  # the slot picked last
        self._follow_ups_in_row = self._watchdogs_in_row = 0
        self._gives_way = False  # to another request, after a follow-up that was not answered
        self._picked_s = self._freed_s = -inf
        for poll in polls:
            self.polls.add(poll, -inf)

    def begin(self, now_s: float) -> None:
        """Begin on an opened port: overdue polls are due now, each unit's first before the others."""
        self._retry = None
        self._freed_s = now_s
        self.polls.begin(now_s)

    def next_due_s(self) -> float:
        """Return when there is something to do, at times a little early; infinity when nothing is planned."""
        retry_s = inf if self._retry is None else self._freed_s
        return min(retry_s, self.jobs.next_s(), self.polls.next_s())

    def pick(self, now_s: float) -> Slot | None:
        """Return what has the line next, None when nothing is due; `record` or `put_back` must follow.

        The first that there is:

        1. A stop's frame.
        2. A repeat or read-back of a stop; after eight in a row one of 3, 5 or 6, with eight of 4 before;
           after a read-back without an answer one of 3 to 6.
        3. A poll whose reply was corrupted, once more; one whose outcome is open.
        4. The unit with the earliest watchdog deadline of those that are due, or were not asked since the
           port was opened; one without a known watchdog after commands in their share; after eight in a
           row 5 or 6 once.
        5. A job, when no poll is due or the jobs' share of line time is not used up: by priority, every
           fourth the oldest.
        6. A poll by due time. After a miss those of units that answer, otherwise those of units that do not.
        """
        self._picked_s, self.is_for_watchdog = now_s, False
        if self._follow_ups_in_row < IN_ROW and not self._gives_way:
            slot = self.jobs.pop(now_s, Priority.STOP, Priority.FOLLOW_UP)
            self._follow_ups_in_row = 0 if slot is None else self._follow_ups_in_row
        else:
            slot = self.jobs.pop(now_s, Priority.STOP)
        if slot is None and self._retry is not None:
            slot = self._take_retry()
        if slot is not None:
            return slot
        unit = self.polls.watchdogs.first(now_s)
        if unit is None or self._watchdogs_in_row >= IN_ROW:
            entry = self.polls.first(now_s)
            slot = self.jobs.pop_command(now_s, is_poll_due=entry is not None)
            if slot is None and entry is not None:
                slot = self.polls.take(entry, now_s)
        elif unit.deadline_s == inf and self.jobs.may_pass_polls(now_s):
            slot = self.jobs.pop(now_s, Priority.COMMAND)
        if slot is None and unit is not None:
            self.is_for_watchdog = True
            slot = self.polls.take(unit.polls[0], now_s)
        return slot or self.jobs.pop(now_s, Priority.FOLLOW_UP)

    def _take_retry(self) -> Slot | None:
        retry, self._retry = self._retry, None
        return retry if retry is not None and self.polls.entry_of(retry.poll) is not None else None

    def put_back(self, slot: Slot, until_s: float = -inf) -> None:
        """Take back a slot that was not sent; its unit may not be asked before `until_s`."""
        if slot.jobs:
            self.jobs.put_back(slot, until_s)
        elif slot.is_repetition and until_s <= self._picked_s:
            self._retry = slot
        else:
            self.polls.put_back(slot, until_s)

    def record(
        self,
        slot: Slot,
        outcome: Outcome,
        now_s: float,
        *,
        is_open: bool = False,
        is_unsure: bool = False,
        is_given_up: bool = False,
    ) -> Verdict:
        """Learn what became of a slot that was picked, and plan on.

        An answer or a refusal is open when the request has to be sent again before it counts, and unsure when
        it may be a late one: that says nothing of the unit as it is now. What its jobs have given up is not
        sent again.
        """
        since_s = min(max(slot.since_s, slot.not_before_s), self._picked_s)
        took_s = min(now_s - max(self._freed_s, since_s), _LONGEST_SLOT_S)
        self._freed_s = now_s
        lane, entry = slot.lane, self.polls.entry_of(slot.poll)
        self._gives_way = self._gives_way and lane is Priority.STOP
        if lane is Priority.FOLLOW_UP:
            self._follow_ups_in_row += 1
            is_lost = isinstance(outcome, Silent | Garbled) and outcome.is_sent
            self._gives_way = is_lost and not slot.is_stop
        elif self.is_for_watchdog:
            self._watchdogs_in_row += 1
        elif lane is not Priority.STOP:
            self._follow_ups_in_row = self._watchdogs_in_row = 0
        is_known = slot.poll is None or entry is not None
        is_repeated = is_known and not is_given_up and (is_open or isinstance(outcome, Garbled))
        is_repeated = is_repeated and self._repeat(slot, outcome, is_open=is_open)
        if slot.jobs:
            self.jobs.charge(slot, took_s, now_s)
        is_online = self.polls.record(
            slot,
            entry,
            outcome,
            sent_s=self._picked_s,
            took_s=took_s,
            now_s=now_s,
            is_repeated=is_repeated,
            is_unsure=is_unsure,
        )
        return Verdict(is_known and not is_repeated, is_online)

    def _repeat(self, slot: Slot, outcome: Outcome, *, is_open: bool) -> bool:
        """Keep a read due that is open, or whose reply was corrupted, once; the line repeats no write."""
        is_corrupted = isinstance(outcome, Garbled) and outcome.is_sent
        is_retried = is_corrupted and not slot.is_repetition and not slot.request.is_write
        if is_retried and slot.jobs and slot.jobs[0].is_literal and isinstance(outcome, Garbled):
            frame = whole_frame(outcome.received)
            is_retried = frame is None or not frame.pdu[0] & EXCEPTION_BIT  # a refusal in doubt is one, too
        if not is_open and not is_retried:
            return False
        again = replace(slot, is_repetition=slot.is_repetition or is_retried)
        if again.jobs:
            self.jobs.put_back(again)
        else:
            self._retry = again
        return True
