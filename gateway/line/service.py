"""An open port, served slot by slot: chosen when the silence ends, sent at once, then recorded."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from gateway.errors import PortLostError, PortResetError
from gateway.line.events import LineEvents
from gateway.line.port_recovery import DEAF, PortRecovery
from gateway.line.rtu.forms import ANYONE, EncodedRequest
from gateway.line.rtu.master import RtuMaster
from gateway.line.rtu.transaction import TOO_LATE, Answered, Garbled, Outcome, Refused, Silent
from gateway.line.scheduler.requests import Job, Priority, Slot
from gateway.line.scheduler.scheduler import Scheduler
from gateway.line.statistics import Statistics

RESET = "reset: a write was not answered in time, and must not act later"
REPLIES_LATE = "its replies come too late: look at response_time_s, and at the family"
IDLE_WAKE_S = 1.0  # an idle line looks at its port so often
GAP_WITHIN_S = 0.1  # so long a stop waits for a gap between two frames of somebody who sends without end


@dataclass(slots=True, kw_only=True)
class LineService:
    """Serves a line whenever its port is open; belongs to the loop that `run` runs on."""

    master: RtuMaster
    port_name: str
    scheduler: Scheduler
    statistics: Statistics
    recovery: PortRecovery
    events: LineEvents
    is_stopping: bool = False
    steps: int = 0  # grows with each transaction and idle wake-up
    _sent: Slot | None = None  # with those of its jobs that still wait for the outcome
    _waker: asyncio.Future[None] | None = None
    _time: Callable[[], float] = field(init=False)

    async def run(self) -> None:
        """Serve until asked to stop; PortLostError when the port is gone, or of no use."""
        self._time = asyncio.get_running_loop().time
        try:
            while not self.is_stopping:
                await self._serve()
        finally:
            self.events.flush()

    def withdraw(self, job: Job) -> bool:
        """Take a job back that has not been sent; False when it is too late: then it is not repeated."""
        if self._sent is not None and job in self._sent.jobs:
            self._sent = self._sent.without(job)
            return False
        return self.scheduler.jobs.withdraw(job)

    def wake(self) -> None:
        """Look at the scheduler again."""
        if self._waker is not None and not self._waker.done():
            self._waker.set_result(None)

    async def _serve(self) -> None:
        """Do what is next: one transaction, or a wait for something to do."""
        master, flush, free_s = self.master, self.events.flush, self._time()
        if self.recovery.is_time_to_ask(free_s):
            self.scheduler.polls.expedite_all(free_s)
        noise = await master.silence.settle(is_for_stop=self.scheduler.jobs.has_stop, meanwhile=flush)
        slot = self.scheduler.pick(free_s)  # it has the line from then on, its silence included
        if slot is None:
            await self._wait_for_work(self.scheduler.next_due_s())
            return
        sent = self._form_of(slot)
        self._sent = slot
        if slot.jobs or noise is not None:
            outcome = await self._take(slot, sent, noise)
        else:
            outcome = await master.send(sent, response_time_s=slot.response_time_s, meanwhile=flush)
        self.steps += 1
        try:
            self._record(slot, sent, outcome, took_s=self._time() - free_s)
        except Exception:
            self._end_jobs(slot)
            raise
        if slot.jobs and _may_act_late(slot, sent, outcome) and master.reset():
            raise PortResetError(self.port_name, RESET)
        was_deaf = self.recovery.is_deaf
        if slot.unit and self.recovery.record(outcome, self._time()):
            raise PortLostError(self.port_name, DEAF)
        if was_deaf and not self.recovery.is_deaf:
            self.events.port_changed("open", is_open=True)

    def _form_of(self, slot: Slot) -> EncodedRequest:
        """Return what is sent for a slot: a stop as it is, all else by what may still come of its unit."""
        poll = slot.poll
        wanted = EncodedRequest.of(slot.unit, slot.request)
        if (poll is None and slot.is_stop) or self.master.forms.outstanding.is_in_step(slot.unit):
            return wanted
        if poll is None:
            poll = next((each.poll for each in self.scheduler.polls.unit(slot.unit).polls), None)
        forms = ANYONE if poll is None else poll.forms
        return self.master.forms.choose(wanted, forms, self._time(), is_poll=slot.poll is not None)

    async def _take(self, slot: Slot, sent: EncodedRequest, noise: Garbled | None) -> Outcome:
        """Do one transaction, unless too late or on too noisy a line; a job ends even when this does not.

        A stop goes out on any line, between or over what others send.
        """
        until_s = slot.until_s
        if self._time() > until_s:
            return Silent(TOO_LATE, is_sent=False)
        if noise is not None and not slot.is_stop:
            return noise
        outcome: Outcome | None = None
        try:
            if noise is not None:
                await self.master.silence.find_gap(GAP_WITHIN_S)
            outcome = await self.master.send(
                sent,
                response_time_s=slot.response_time_s,
                until_s=until_s,
                meanwhile=self.events.flush,
            )
            if slot.lane is Priority.STOP and outcome != Silent(TOO_LATE, is_sent=False):
                self.statistics.note_stop(slot, self.master.written_s)
        finally:
            if outcome is None:
                for job in slot.jobs:
                    self.events.job_done(job, Silent("port lost", is_sent=self.master.is_on_wire))
        return outcome if noise is None else replace(outcome, is_over_babble=True)

    def _record(self, slot: Slot, sent: EncodedRequest, outcome: Outcome, *, took_s: float) -> None:
        """Record an outcome, and hand it over as events."""
        now_s = self._time()
        if self.master.strays.late_units:
            self._note_late_units(now_s)
        is_given_up = bool(slot.jobs) and self._sent is None
        self._sent = None
        self.statistics.note(slot, outcome, took_s=took_s, now_s=now_s)
        is_plain = isinstance(outcome, Answered) and not sent.is_fence
        verdict = self.scheduler.record(
            slot, outcome, now_s, is_open=not is_plain and _is_open(sent, outcome), is_given_up=is_given_up
        )
        while self.master.bus_faults.news:
            self.events.fault(self.master.bus_faults.news.popleft())
        if verdict.is_answering is not None:
            is_late = not verdict.is_answering and self.scheduler.polls.unit(slot.unit).is_late(now_s)
            why = Silent(REPLIES_LATE) if is_late else outcome
            self.events.unit_changed(slot.unit, why, is_answering=verdict.is_answering)
        if not verdict.is_final:
            return
        if sent.is_fence and slot.request.is_write:
            outcome = Silent(TOO_LATE, is_sent=False)  # the write itself: its unit is not in step
        for job in slot.jobs:
            self.events.job_done(job, outcome)
        if slot.poll is not None:
            self.events.poll_done(slot.poll, outcome)

    def _note_late_units(self, now_s: float) -> None:
        """Record which units have answered late: they are there."""
        late_units = self.master.strays.late_units
        for unit in late_units:
            self.scheduler.polls.note_late(unit, now_s)
            self.statistics.note_late(unit)
            self.recovery.note_late()
        late_units.clear()

    def _end_jobs(self, slot: Slot) -> None:
        """End the jobs of a slot that a bug has cut off: the line restarts without them."""
        for job in slot.jobs:
            self.scheduler.jobs.withdraw(job)
            self.events.job_done(job, Silent("line crashed", is_sent=True))

    async def _wait_for_work(self, until_s: float) -> None:
        """Sleep until then, or until a job comes or it is time to look at the port."""
        self.events.flush()
        loop = asyncio.get_running_loop()
        self._waker = loop.create_future()
        timer = loop.call_at(min(until_s, self._time() + IDLE_WAKE_S), self.wake)
        try:
            await self._waker
        finally:
            timer.cancel()
            self._waker = None
        self.steps += 1


def _is_open(sent: EncodedRequest, outcome: Outcome) -> bool:
    """Return whether a slot's own request has to follow: a fence was answered, or another form refused."""
    if isinstance(outcome, Answered):
        return sent.is_fence
    return isinstance(outcome, Refused) and (sent.is_fence or (outcome.is_lasting and sent.cut is not None))


def _may_act_late(slot: Slot, sent: EncodedRequest, outcome: Outcome) -> bool:
    """Return whether a write that must not act late was sent, and it is not known that it arrived."""
    is_unsure = isinstance(outcome, Silent | Garbled) and outcome.is_sent
    return is_unsure and not sent.is_fence and any(job.must_not_act_late for job in slot.jobs)
