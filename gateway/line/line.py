"""One line's loop: the plan decides, the transactor keeps the timing, nothing hides here."""

from __future__ import annotations

import asyncio
import logging
import random
from collections.abc import Callable, Sequence
from math import inf
from typing import Any

from gateway.errors import PortError, PortLostError, PortResetError
from gateway.line.capacity.forecast import worst_stop_latency_s
from gateway.line.events import EventQueue, LineEvents
from gateway.line.port.base import Port, PortOpener
from gateway.line.port.tty import CountsErrors
from gateway.line.port_recovery import PortRecovery
from gateway.line.rtu.forms import Alternates, Forms
from gateway.line.rtu.late_replies import LateReplies
from gateway.line.rtu.outcome import Silent
from gateway.line.rtu.timeouts import ALLOWANCE_S
from gateway.line.rtu.trace import Trace
from gateway.line.rtu.transaction import RtuMaster
from gateway.line.scheduler.requests import Job, Poll
from gateway.line.scheduler.scheduler import Scheduler
from gateway.line.service import IDLE_WAKE_S, LineService
from gateway.line.statistics import Statistics
from gateway.modbus.timing import LineTiming

logger = logging.getLogger(__name__)

REOPEN_FLOOR_S = 0.5
REOPEN_CEILING_S = 2.0  # an adapter that is plugged in again is to be found at once


class Line:
    """Serves one line; everything but `__init__` belongs to the loop that `run` runs on."""

    def __init__(
        self,
        *,
        name: str,
        opener: PortOpener,
        timing: LineTiming,
        polls: Sequence[Poll],
        events: EventQueue,
        allowance_s: float = ALLOWANCE_S,
        seed: int = 0,
        deaf_after_s: float | None = None,
        alternates_of: Alternates = lambda _: (),  # other forms of reads of units without polls
    ) -> None:
        self.name = name
        self.timing = timing
        self._steps = 0  # attempts to open, and what earlier ports were good for
        self._opener = opener
        self._allowance_s = allowance_s
        self._alternates_of = alternates_of
        self._forms = Forms(LateReplies())
        self._scheduler = Scheduler(polls, chance=random.Random(seed))
        self._trace = Trace(name)
        self.events = LineEvents(name, events, self._trace)
        self._figures = Statistics()
        self._deafness = PortRecovery(deaf_after_s)
        self._time: Callable[[], float] = lambda: -inf
        self._serving: LineService | None = None  # while the port is open
        self._is_stopping = False
        self._is_reopening = False  # after a reset on purpose: jobs wait for the new connection
        self._earlier_stray_bytes = 0

    @property
    def progress(self) -> int:
        """Return a count that grows with each transaction, idle wake-up and attempt to open."""
        serving = self._serving
        return self._steps if serving is None else self._steps + serving.steps

    async def run(self) -> None:
        """Serve this line until cancelled; a transaction whose request is sent then still runs to its end."""
        self._is_stopping = False
        living = asyncio.create_task(self._live(), name=f"line {self.name}")
        try:
            await asyncio.shield(living)
        except asyncio.CancelledError:
            self._is_stopping = True
            if self._serving is not None:
                self._serving.is_stopping = True
            if self._serving is None or not self._serving.line.is_on_wire:
                living.cancel()
            await asyncio.wait([living])
            raise

    def submit(self, job: Job) -> None:
        """Queue a job; without a port it ends at once."""
        if self._is_reopening:
            self._scheduler.jobs.submit(job, self._time())
        elif self._serving is None:
            self.events.job_done(job, Silent("port closed", is_sent=False))
            self.events.flush()
        else:
            self._serving.submit(job)

    def withdraw(self, job: Job) -> bool:
        """Take a waiting job back, so that it is never sent; False when it is too late for that."""
        if self._is_reopening:
            return self._scheduler.jobs.withdraw(job)
        return self._serving is not None and self._serving.withdraw(job)

    def change(self, change: Callable[[Scheduler, float], object]) -> None:
        """Change what is asked, and how often; given the time."""
        change(self._scheduler, self._time())
        self._wake()

    def forget(self, unit: int) -> None:
        """Know nothing of a unit any more, whose polls are removed."""
        self._scheduler.polls.forget(unit)
        self._forms.forget(unit)
        self._figures.forget(unit)

    def figures(self) -> dict[str, Any]:
        """Return the counters and times of this line."""
        polls = self._scheduler.polls.asked()
        latency_s = worst_stop_latency_s(polls, self.timing, allowance_s=self._allowance_s)
        figures = self._figures.to_dict(polls, worst_stop_latency_s=latency_s, now_s=self._time())
        for unit, counts in figures["units"].items():
            counts["state"] = self._scheduler.polls.state_of(unit).value
        state = {
            "is_open": self._serving is not None,
            "stretch": round(self._scheduler.polls.stretch, 3),
            "watchdogs": self._scheduler.polls.watchdog_statistics(self._time()),
        }
        stray_bytes = self._earlier_stray_bytes + (self._serving.line.stray_bytes if self._serving else 0)
        errors = self._opener.uart_errors() if isinstance(self._opener, CountsErrors) else None
        uart = {} if errors is None else {"uart_errors": errors}
        return {**state, "progress": self.progress, "stray_bytes": stray_bytes, **uart, **figures}

    async def _live(self) -> None:
        """Serve as long as the line runs; leave nobody waiting."""
        self._time = asyncio.get_running_loop().time
        try:
            await self._keep_open()
        finally:
            self._end_jobs()

    async def _keep_open(self) -> None:
        """Open the port, serve, and reopen when it is lost, ever less often while that is no use."""
        pause_s = REOPEN_FLOOR_S
        while True:
            self._steps += 1
            tried_s = self._time()
            try:
                port = await self._opener()
            except PortError as error:
                self._end_jobs()
                self.events.port_changed(str(error), is_open=False)
            else:
                await self._use(port)
            if self._is_stopping:
                return
            if self._is_reopening:
                continue
            if self._time() - tried_s > REOPEN_CEILING_S:
                pause_s = REOPEN_FLOOR_S
            await self._pause(pause_s)
            pause_s = min(2 * pause_s, REOPEN_CEILING_S)

    async def _pause(self, pause_s: float) -> None:
        """Wait without standing still: whoever watches `progress` must not take a missing port for a hang."""
        until_s = self._time() + pause_s
        while (left_s := until_s - self._time()) > 0:
            await asyncio.sleep(min(left_s, IDLE_WAKE_S))
            self._steps += 1

    async def _use(self, port: Port) -> None:
        """Serve on an open port until it is lost or we stop; leave it closed.

        After a reset of ours the jobs wait for the new connection, and nothing is published of it.
        """
        self._is_reopening = False
        line = RtuMaster(
            port, self.timing, allowance_s=self._allowance_s, trace=self._trace, forms=self._forms
        )
        serving = self._serving = self._serving_of(line)
        self._scheduler.begin(self._time())
        self._figures.begin(self._time())
        self._deafness.begin()
        try:
            if self._deafness.is_deaf:
                serving.ask_all_anew()
            else:
                self.events.port_changed("open", is_open=True)
            await asyncio.create_task(serving.run(), name=f"serve {self.name}")
        except PortResetError as error:
            logger.info("line=%s %s", self.name, error)
            self._is_reopening = True
        except PortLostError as error:
            self.events.port_changed(str(error), is_open=False)
        finally:
            self._steps += serving.steps
            self._serving = None
            self._earlier_stray_bytes += line.stray_bytes
            port.close()
            if not self._is_reopening:
                self._end_jobs()

    def _end_jobs(self) -> None:
        self._is_reopening = False
        for job in self._scheduler.jobs.clear():
            self.events.job_done(job, Silent("port closed", is_sent=False))
        self.events.flush()

    def _serving_of(self, line: RtuMaster) -> LineService:
        return LineService(
            line,
            port_name=self._opener.name,
            scheduler=self._scheduler,
            figures=self._figures,
            deafness=self._deafness,
            events=self.events,
            alternates_of=self._alternates_of,
        )

    def _wake(self) -> None:
        if self._serving is not None:
            self._serving.wake()
