"""One line's loop: the plan decides, the transactor keeps the timing, nothing hides here."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from math import inf
from typing import Any

from gateway.errors import PortError, PortLostError
from gateway.line.budget import ALLOWANCE_S, worst_stop_latency_s
from gateway.line.figures import Figures
from gateway.line.job import Job, Poll
from gateway.line.listener import LineListener
from gateway.line.outcome import Garbled, Outcome, Silent
from gateway.line.plan import Plan, Turn
from gateway.line.port import Port, PortOpener
from gateway.line.trace import Trace
from gateway.line.transaction import Transactor
from gateway.modbus.timing import LineTiming

REOPEN_FLOOR_S = 0.5
REOPEN_CEILING_S = 10.0
IDLE_WAKE_S = 1.0  # an idle line looks at its port so often

logger = logging.getLogger(__name__)


class Scheduler:
    """Serves one line; everything but `__init__` belongs to the loop that `run` runs on."""

    def __init__(
        self,
        *,
        name: str,
        opener: PortOpener,
        timing: LineTiming,
        polls: Sequence[Poll],
        listener: LineListener,
        allowance_s: float = ALLOWANCE_S,
        seed: int = 0,
    ) -> None:
        self.name = name
        self.timing = timing
        self.progress = 0  # grows with each transaction, idle wake-up and attempt to open
        self._opener = opener
        self._listener = listener
        self._allowance_s = allowance_s
        self._plan = Plan(polls, seed=seed)
        self._trace = Trace(name)
        self._figures = Figures()
        self._time: Callable[[], float] = lambda: -inf
        self._line: Transactor | None = None
        self._waker: asyncio.Future[None] | None = None
        self._is_stopping = False
        self._told_port: tuple[bool, str] | None = None
        self._earlier_stray_bytes = 0

    async def run(self) -> None:
        """Serve this line until cancelled; a transaction whose request is sent then still runs to its end."""
        self._is_stopping = False
        serving = asyncio.create_task(self._live(), name=f"line {self.name}")
        try:
            await asyncio.shield(serving)
        except asyncio.CancelledError:
            self._is_stopping = True
            if self._line is None or not self._line.is_on_wire:
                serving.cancel()
            await asyncio.wait([serving])
            raise

    def submit(self, job: Job) -> None:
        """Queue a job; without a port it ends at once."""
        if self._line is None:
            job.finish(Silent("port closed", is_sent=False))
            return
        self._plan.submit(job, self._time())
        self._wake()

    def withdraw(self, job: Job) -> bool:
        """Take a waiting job back, so that it is never sent; False when it is too late for that."""
        return self._plan.withdraw(job)

    def add_poll(self, poll: Poll) -> None:
        """Repeat a request from now on; ValueError when its key is taken."""
        self._plan.add_poll(poll, self._time())
        self._wake()

    def remove_poll(self, key: str) -> None:
        """Ask no more; KeyError when there is no such poll."""
        self._plan.remove_poll(key)

    def set_every(self, key: str, every_s: float) -> None:
        """Change a poll's period; KeyError when there is no such poll."""
        self._plan.set_every(key, every_s, self._time())
        self._wake()

    def hasten(self, key: str) -> None:
        """Make a poll due now; KeyError when there is no such poll."""
        self._plan.hasten(key, self._time())
        self._wake()

    def expect_silence(self, unit: int, seconds: float) -> None:
        """Count no misses of this unit for so long."""
        self._plan.expect_silence(unit, self._time() + seconds)

    def figures(self) -> dict[str, Any]:
        """Return the counters and times of this line."""
        polls = self._plan.polls()
        latency_s = worst_stop_latency_s(polls, self.timing, allowance_s=self._allowance_s)
        figures = self._figures.to_dict(polls, worst_stop_latency_s=latency_s, now_s=self._time())
        for unit, counts in figures["units"].items():
            counts["state"] = self._plan.state_of(unit).value
        stray_bytes = self._earlier_stray_bytes + (self._line.stray_bytes if self._line else 0)
        is_open = self._line is not None
        return {"is_open": is_open, "progress": self.progress, "stray_bytes": stray_bytes, **figures}

    async def _live(self) -> None:
        """Open the port, serve, and reopen when it is lost, ever less often while that is no use."""
        self._time = asyncio.get_running_loop().time
        pause_s = REOPEN_FLOOR_S
        while True:
            self.progress += 1
            tried_s = self._time()
            try:
                port = await self._opener()
            except PortError as error:
                self._tell_port(str(error), is_open=False)
            else:
                await self._use(port)
            if self._is_stopping:
                return
            if self._time() - tried_s > REOPEN_CEILING_S:
                pause_s = REOPEN_FLOOR_S
            await asyncio.sleep(pause_s)
            pause_s = min(2 * pause_s, REOPEN_CEILING_S)

    async def _use(self, port: Port) -> None:
        """Serve on an open port until it is lost or we stop; leave it closed and nobody waiting."""
        line = Transactor(port, self.timing, allowance_s=self._allowance_s, trace=self._trace)
        self._line = line
        self._plan.begin(self._time())
        self._figures.begin(self._time())
        try:
            self._tell_port("open", is_open=True)
            await self._serve(line)
        except PortLostError as error:
            self._tell_port(str(error), is_open=False)
        finally:
            self._line = None
            self._earlier_stray_bytes += line.stray_bytes
            port.close()
            for job in self._plan.take_jobs():
                job.finish(Silent("port closed", is_sent=False))

    async def _serve(self, line: Transactor) -> None:
        """Choose only once the line is free, so that a stop waits for one transaction at the most."""
        while not self._is_stopping:
            free_s = self._time()
            noise = await line.settle()
            turn = self._plan.pick(self._time())
            if turn is None:
                await self._wait_for_work(self._plan.next_due_s())
                continue
            free_from_s = line.free_from_s(turn.unit, turn.request)
            if noise is None and free_from_s > self._time():
                await self._put_back(turn, free_from_s)
                continue
            outcome = await self._take(turn, line, noise)
            self.progress += 1
            self._record(turn, outcome, took_s=self._time() - free_s)

    async def _take(self, turn: Turn, line: Transactor, noise: Garbled | None) -> Outcome:
        """Do one transaction, unless the line is too noisy; a job ends even when this does not."""
        outcome: Outcome | None = noise
        try:
            if outcome is None:
                asked_s = self._time()
                outcome = await line.transact(turn.unit, turn.request, response_time_s=turn.response_time_s)
                if line.written_s >= asked_s:
                    self._figures.note_sent(turn, line.written_s)
        finally:
            if outcome is None and turn.job is not None:
                turn.job.finish(Silent("port lost", is_sent=line.is_on_wire))
        return outcome

    def _record(self, turn: Turn, outcome: Outcome, *, took_s: float) -> None:
        """Plan on, and tell whoever waits for this outcome."""
        now_s = self._time()
        self._figures.note(turn, outcome, took_s=took_s, now_s=now_s)
        verdict = self._plan.record(turn, outcome, now_s)
        if verdict.is_answering is not None:
            self._tell_unit(turn.unit, outcome, is_answering=verdict.is_answering)
        if not verdict.is_final:
            return
        if turn.job is not None:
            turn.job.finish(outcome)
        elif turn.poll is not None:
            self._listener.on_poll(self.name, turn.poll.key, turn.unit, outcome)

    def _tell_unit(self, unit: int, outcome: Outcome, *, is_answering: bool) -> None:
        frames = self._trace.frames()
        reason = outcome.reason if isinstance(outcome, Silent | Garbled) else "answers"
        if is_answering:
            logger.info("line=%s unit=%s answers", self.name, unit)
        else:
            shown = "\n".join(frames)
            logger.warning(
                "line=%s unit=%s went silent: %s; last frames:\n%s", self.name, unit, reason, shown
            )
        self._listener.on_unit(self.name, unit, is_answering, reason, frames)

    def _tell_port(self, reason: str, *, is_open: bool) -> None:
        """Tell a change of the port's state, or of the reason why it is away, once."""
        if self._told_port == (is_open, reason):
            return
        self._told_port = (is_open, reason)
        logger.log(logging.INFO if is_open else logging.ERROR, "line=%s %s", self.name, reason)
        self._listener.on_port(self.name, is_open, reason)

    async def _put_back(self, turn: Turn, until_s: float) -> None:
        """Let the unit's late reply come first; nothing but a new job is worth ending that wait for."""
        self._plan.put_back(turn, until_s)
        if turn.job is not None:
            await self._wait_for_work(until_s)

    async def _wait_for_work(self, until_s: float) -> None:
        """Sleep until then, or until a job comes or it is time to look at the port."""
        until_s = min(until_s, self._time() + IDLE_WAKE_S)
        loop = asyncio.get_running_loop()
        self._waker = loop.create_future()
        timer = loop.call_at(until_s, self._wake)
        try:
            await self._waker
        finally:
            timer.cancel()
            self._waker = None
        self.progress += 1

    def _wake(self) -> None:
        if self._waker is not None and not self._waker.done():
            self._waker.set_result(None)
