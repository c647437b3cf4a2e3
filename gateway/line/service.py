"""One open port, served turn by turn: chosen while the silence runs, sent when it ends, told once sent."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from math import inf

from gateway.errors import PortLostError, PortResetError
from gateway.line.events import Notifications
from gateway.line.port_recovery import DEAF, PortRecovery
from gateway.line.rtu.outcome import TOO_LATE, Garbled, Outcome, Silent
from gateway.line.rtu.request import RequestCache
from gateway.line.rtu.transaction import RtuMaster
from gateway.line.scheduler.requests import Job, Priority, Slot
from gateway.line.scheduler.scheduler import Scheduler
from gateway.line.statistics import Statistics
from gateway.line.stop_hold import LOOK_EVERY_S, StopHold

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
        plan: Scheduler,
        figures: Statistics,
        deafness: PortRecovery,
        doorstep: StopHold,
        preparations: RequestCache,
        voice: Notifications,
        step: Callable[[], None],
    ) -> None:
        self.line = line
        self.is_stopping = False
        self._port_name = port_name
        self._plan = plan
        self._figures = figures
        self._deafness = deafness
        self._doorstep = doorstep
        self._preparations = preparations
        self._voice = voice
        self._step = step  # called whenever the loop gets on
        self._time = asyncio.get_running_loop().time
        self._turn: Slot | None = None  # chosen, not yet sent
        self._is_overtaken = False  # by a job that came since
        self._has_stop = False  # which came since
        self._gave_way = False  # a poll, once already since the last one was sent
        self._waker: asyncio.Future[None] | None = None

    async def run(self) -> None:
        """Serve until asked to stop; PortLostError when the port is gone, or of no use."""
        try:
            await self._run()
        finally:
            if self._turn is not None:
                self._plan.put_back(self._turn)
                self._turn = None
            self._voice.flush()

    def submit(self, job: Job) -> None:
        """Queue a job: a stop goes before whatever has been chosen, others before a poll, not for ever."""
        self._plan.jobs.submit(job, self._time())
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
        return self._plan.jobs.withdraw(job)

    def wake(self) -> None:
        """Look at the plan again."""
        if self._waker is not None and not self._waker.done():
            self._waker.set_result(None)

    def ask_all_anew(self) -> None:
        """Ask those at once who are only silent because nobody could be heard."""
        self._plan.polls.expedite_all(self._time())

    async def _run(self) -> None:
        line = self.line
        while not self.is_stopping:
            free_s = self._time()
            if self._deafness.is_time_to_ask(free_s):
                self.ask_all_anew()
            self._choose(max(line.quiet_from_s(), free_s))
            noise = await self._fall_silent()
            if noise is None and await self._let_in():
                noise = await self._fall_silent()
            turn = self._chosen()
            if turn is None:
                self._voice.flush()
                await self._wait_for_work(self._plan.next_due_s())
                continue
            free_from_s = line.free_from_s(turn.unit, turn.request)
            if noise is None and free_from_s > self._time():
                self._plan.put_back(turn, free_from_s)
                continue
            outcome = await self._take(turn, noise)
            self._step()
            self._record(turn, outcome, took_s=self._time() - free_s)
            if _may_act_late(turn, outcome) and line.reset():
                raise PortResetError(self._port_name, RESET)
            if turn.unit and self._deafness.take(outcome, self._time()):
                raise PortLostError(self._port_name, DEAF)
            if not self._deafness.is_deaf:
                self._voice.tell_port("open", is_open=True)

    def _choose(self, when_s: float) -> None:
        """Choose what is to be sent then."""
        self._is_overtaken = self._has_stop = False
        self._turn = self._plan.pick(when_s)

    def _chosen(self) -> Slot | None:
        """Return what is to be sent now: what was chosen, unless a stop came since or there was nothing."""
        if self._turn is not None and self._is_overtaken:
            self._plan.put_back(self._turn)
            self._turn = None
        if self._turn is None:
            self._choose(self._time())
        turn, self._turn = self._turn, None
        return turn

    async def _fall_silent(self) -> Garbled | None:
        """Wait until anything may be sent; Garbled when the line does not become quiet."""
        if await self.line.hush():
            return None
        self._voice.flush()  # this may take long
        return await self.line.settle(is_for_stop=self._is_stop_waiting)

    def _is_stop_waiting(self) -> bool:
        return self._has_stop or (self._turn is not None and self._turn.is_stop)

    async def _let_in(self) -> bool:
        """Hold what was chosen back while a stop may be about to come; return whether that took time."""
        began_s = self._time()
        if self._turn is None or self._turn.is_stop or not self._doorstep.is_worth_waiting(began_s):
            return False
        now_s = began_s
        while not self._has_stop and self._doorstep.is_worth_waiting(now_s, began_s):
            await self._sleep(now_s + LOOK_EVERY_S)
            now_s = self._time()
        self._doorstep.waited(began_s, now_s)
        return True

    async def _take(self, turn: Slot, noise: Garbled | None) -> Outcome:
        """Do one transaction, unless too late or on too noisy a line; a job ends even when this does not.

        A stop goes out on any line, between or over what others send.
        """
        until_s = inf if turn.job is None else turn.job.until_s
        if self._time() > until_s:
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
            prepared = self._preparations.of(poll.key if poll else None, turn.unit, turn.request)
            outcome = await self.line.exchange(
                prepared,
                response_time_s=self._figures.response_time_s(turn),
                longest_s=turn.response_time_s,
                until_s=until_s,
                meanwhile=self._voice.flush,
            )
            if outcome != Silent(TOO_LATE, is_sent=False):
                self._figures.note_sent(turn, self.line.written_s)
        finally:
            if outcome is None:
                for job in turn.jobs:
                    self._voice.finish(job, Silent("port lost", is_sent=self.line.is_on_wire))
        return outcome if noise is None else replace(outcome, is_over_babble=True)

    def _record(self, turn: Slot, outcome: Outcome, *, took_s: float) -> None:
        """Plan on, and have it told to whoever waits for this outcome."""
        now_s = self._time()
        self._figures.note(turn, outcome, took_s=took_s, now_s=now_s)
        verdict = self._plan.record(turn, outcome, now_s)
        for trouble in self.line.suspicions.take_news():
            self._voice.tell_trouble(trouble)
        if verdict.is_answering is not None:
            self._voice.tell_unit(turn.unit, outcome, is_answering=verdict.is_answering)
        if not verdict.is_final:
            return
        for job in turn.jobs:
            self._voice.finish(job, outcome)
        if turn.poll is not None:
            self._voice.tell_poll(turn.poll, outcome)

    async def _wait_for_work(self, until_s: float) -> None:
        """Sleep until then, or until a job comes or it is time to look at the port."""
        self._voice.flush()
        await self._sleep(min(until_s, self._time() + IDLE_WAKE_S))
        self._step()

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


def _may_act_late(turn: Slot, outcome: Outcome) -> bool:
    """Return whether a write that must not act late was sent, and it is not known that it arrived."""
    is_unsure = isinstance(outcome, Silent | Garbled) and outcome.is_sent
    return is_unsure and turn.job is not None and turn.job.must_not_act_late
