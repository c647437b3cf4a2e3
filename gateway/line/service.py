"""One open port, served turn by turn: chosen while the silence runs, sent when it ends, told once sent."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from math import inf

from gateway.errors import PortLostError, PortResetError
from gateway.line.events import LineEvents
from gateway.line.port_recovery import DEAF, PortRecovery
from gateway.line.rtu.forms import Alternates
from gateway.line.rtu.late_replies import COPY_S, LOOK_AGAIN_S, Agreed
from gateway.line.rtu.outcome import TOO_LATE, Answered, Garbled, Outcome, Refused, Silent
from gateway.line.rtu.request import EncodedRequest
from gateway.line.rtu.transaction import RtuMaster
from gateway.line.scheduler.requests import Job, Priority, Slot
from gateway.line.scheduler.scheduler import Scheduler
from gateway.line.statistics import Statistics

RESET = "reset: a write was not answered in time, and must not act later"
IDLE_WAKE_S = 1.0  # an idle line looks at its port so often
GAP_WITHIN_S = 0.1  # so long a stop waits for a gap between two frames of somebody who sends without end


class LineService:
    """Serves a line on a port as long as it is open; belongs to the loop that `run` runs on."""

    def __init__(
        self,
        line: RtuMaster,
        *,
        port_name: str,
        scheduler: Scheduler,
        figures: Statistics,
        deafness: PortRecovery,
        events: LineEvents,
        alternates_of: Alternates,  # for units without polls
    ) -> None:
        self.line = line
        self.is_stopping = False
        self._port_name = port_name
        self._scheduler = scheduler
        self._figures = figures
        self._deafness = deafness
        self._events = events
        self._alternates_of = alternates_of
        self.steps = 0  # grows with each transaction and idle wake-up
        self._time = asyncio.get_running_loop().time
        self._turn: Slot | None = None  # chosen, not yet sent
        self._is_overtaken = False  # by a job that came since
        self._has_stop = False  # which came since
        self._gave_way = False  # a poll, once already since the last one was sent
        self._waker: asyncio.Future[None] | None = None

    async def run(self) -> None:
        """Serve until asked to stop; PortLostError when the port is gone, or of no use."""
        try:
            while not self.is_stopping:
                await self._serve()
        finally:
            if self._turn is not None:
                self._scheduler.put_back(self._turn)
                self._turn = None
            self._events.flush()

    def submit(self, job: Job) -> None:
        """Queue a job: a stop goes before whatever has been chosen, others before a poll, not for ever."""
        self._scheduler.jobs.submit(job, self._time())
        if job.lane <= Priority.FOLLOW_UP:
            self._is_overtaken = True
            self._has_stop = self._has_stop or job.lane is Priority.STOP or job.request.is_write
        elif self._turn is not None and self._turn.poll is not None and not self._gave_way:
            self._is_overtaken = self._gave_way = True
        self.wake()

    def withdraw(self, job: Job) -> bool:
        """Take a job back that has not been sent; False when it is too late for that."""
        if self._turn is not None and any(each is job for each in self._turn.jobs):
            self._turn = self._turn.without(job)
            return True
        return self._scheduler.jobs.withdraw(job)

    def wake(self) -> None:
        """Look at the plan again."""
        if self._waker is not None and not self._waker.done():
            self._waker.set_result(None)

    def ask_all_anew(self) -> None:
        """Ask those at once who are only silent because nobody could be heard."""
        self._scheduler.polls.expedite_all(self._time())

    async def _serve(self) -> None:
        """Do what is next: one transaction, or a wait for something to do."""
        line = self.line
        free_s = self._time()
        if self._deafness.is_time_to_ask(free_s):
            self.ask_all_anew()
        self._choose(max(line.quiet_from_s(), free_s))
        noise = None if await line.hush() else await self._settle()
        turn = self._chosen()
        if turn is None:
            await self._wait_for_work(self._scheduler.next_due_s())
            return
        encoded = EncodedRequest.of(turn.unit, turn.request)
        form = self._form_of(turn, encoded)
        if form is None and noise is None and not self._is_too_late(turn):
            self._scheduler.put_back(turn, line.late.free_from_s(turn.unit, turn.request, self._time()))
            return
        outcome = await self._take(turn, form or encoded, noise)
        self.steps += 1
        self._record(turn, form or encoded, outcome, took_s=self._time() - free_s)
        if _may_act_late(turn, outcome) and line.reset():
            raise PortResetError(self._port_name, RESET)
        was_deaf = self._deafness.is_deaf
        if turn.unit and self._deafness.take(outcome, self._time()):
            raise PortLostError(self._port_name, DEAF)
        if was_deaf and not self._deafness.is_deaf:
            self._events.port_changed("open", is_open=True)

    def _choose(self, when_s: float) -> None:
        """Choose what is to be sent then."""
        self._is_overtaken = self._has_stop = False
        self._turn = self._scheduler.pick(when_s)

    def _chosen(self) -> Slot | None:
        """Return what is to be sent now: what was chosen, unless a stop came since or there was nothing."""
        if self._turn is not None and self._is_overtaken:
            self._scheduler.put_back(self._turn)
            self._turn = None
        if self._turn is None:
            self._choose(self._time())
        turn, self._turn = self._turn, None
        return turn

    async def _settle(self) -> Garbled | None:
        """Wait until anything may be sent on a line that was not silent; Garbled when it does not become."""
        self._events.flush()  # this may take long
        return await self.line.settle(is_for_stop=self._is_stop_waiting)

    def _is_stop_waiting(self) -> bool:
        return self._has_stop or (self._turn is not None and self._turn.is_stop)

    def _form_of(self, turn: Slot, encoded: EncodedRequest) -> EncodedRequest | None:
        """Return the form in which a slot's request is sent; None while an earlier reply may pass."""
        poll = turn.poll
        any_poll = poll or self._scheduler.polls.probe_of(turn.unit)
        return self.line.forms.choose(
            encoded,
            self._alternates_of if any_poll is None else any_poll.alternates_of,
            self._time(),
            is_decisive=poll is None or poll.is_urgent,
            is_patient=poll is not None,
        )

    async def _take(self, turn: Slot, encoded: EncodedRequest, noise: Garbled | None) -> Outcome:
        """Do one transaction, unless too late or on too noisy a line; a job ends even when this does not.

        A stop goes out on any line, between or over what others send.
        """
        if self._is_too_late(turn):
            return Silent(TOO_LATE, is_sent=False)
        if noise is not None and not turn.is_stop:
            return noise
        outcome: Outcome | None = None
        poll = turn.poll
        if poll is not None:
            self._gave_way = False
        try:
            if noise is not None:
                await self.line.find_gap(GAP_WITHIN_S)
            outcome = await self.line.exchange(
                encoded,
                response_time_s=self._figures.response_time_s(turn),
                until_s=_until_s(turn),
                meanwhile=self._events.flush,
            )
            if turn.is_stop and outcome != Silent(TOO_LATE, is_sent=False):
                self._figures.note_sent(turn, self.line.written_s)
        finally:
            if outcome is None:
                for job in turn.jobs:
                    self._events.job_done(job, Silent("port lost", is_sent=self.line.is_on_wire))
        return outcome if noise is None else replace(outcome, is_over_babble=True)

    def _record(self, turn: Slot, sent: EncodedRequest, outcome: Outcome, *, took_s: float) -> None:
        """Record an outcome, and hand it over as events."""
        now_s = self._time()
        self._figures.note(turn, outcome, took_s=took_s, now_s=now_s)
        agreed = self.line.agrees(sent, outcome) if isinstance(outcome, Answered) and sent.times > 1 else None
        if agreed is Agreed.NO:
            self._scheduler.put_back(turn, now_s + (COPY_S if turn.poll is None else LOOK_AGAIN_S))
            return
        is_other_form_refused = isinstance(outcome, Refused) and outcome.is_lasting and sent.cut is not None
        is_open = agreed is Agreed.NOT_YET or is_other_form_refused
        verdict = self._scheduler.record(turn, outcome, now_s, is_open=is_open)
        for fault in self.line.suspicions.take_news():
            self._events.fault(fault)
        if verdict.is_answering is not None:
            self._events.unit_changed(turn.unit, outcome, is_answering=verdict.is_answering)
        if not verdict.is_final:
            return
        for job in turn.jobs:
            self._events.job_done(job, outcome)
        if turn.poll is not None:
            self._events.poll_done(turn.poll, outcome)

    def _is_too_late(self, turn: Slot) -> bool:
        return self._time() > _until_s(turn)

    async def _wait_for_work(self, until_s: float) -> None:
        """Sleep until then, or until a job comes or it is time to look at the port."""
        self._events.flush()
        await self._sleep(min(until_s, self._time() + IDLE_WAKE_S))
        self.steps += 1

    async def _sleep(self, until_s: float) -> None:
        """Let go until then, or until somebody wakes us."""
        loop = asyncio.get_running_loop()
        self._waker = loop.create_future()
        timer = loop.call_at(until_s, self.wake)
        try:
            await self._waker
        finally:
            timer.cancel()
            self._waker = None


def _until_s(turn: Slot) -> float:
    """Return after what time a slot's request is not sent any more."""
    return inf if turn.job is None else turn.job.until_s


def _may_act_late(turn: Slot, outcome: Outcome) -> bool:
    """Return whether a write that must not act late was sent, and it is not known that it arrived."""
    is_unsure = isinstance(outcome, Silent | Garbled) and outcome.is_sent
    return is_unsure and turn.job is not None and turn.job.must_not_act_late
