"""One line: its port is opened and served, again and again; what is asked and said reaches it here."""

from __future__ import annotations

import asyncio
import logging
import random
from collections.abc import Callable, Sequence
from math import inf
from typing import Any

from gateway.errors import PortError, PortLostError, PortResetError
from gateway.line.events import EventQueue, LineEvents, Trace
from gateway.line.port.base import Port, PortOpener
from gateway.line.port.tty import CountsErrors
from gateway.line.port_recovery import PortRecovery
from gateway.line.rtu.master import RtuMaster
from gateway.line.rtu.transaction import ALLOWANCE_S, TOO_LATE, Silent
from gateway.line.scheduler.requests import Job, Poll
from gateway.line.scheduler.scheduler import Scheduler
from gateway.line.service import IDLE_WAKE_S, LineService
from gateway.line.statistics import Statistics
from gateway.modbus import LineTiming
from gateway.system.rate_limits import Backoff

logger = logging.getLogger(__name__)

REOPEN_MIN_S = 0.5
REOPEN_MAX_S = 2.0  # an adapter that is plugged in again is to be found at once


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
    ) -> None:
        self.name = name
        self.timing = timing
        self.events = LineEvents(name, events, Trace(name))
        self._opener = opener
        self._scheduler = Scheduler(polls, chance=random.Random(seed))
        self.polls = self._scheduler.polls
        self._statistics = Statistics()
        self._recovery = PortRecovery(deaf_after_s)
        self._master = RtuMaster(timing, allowance_s=allowance_s, note_frame=self.events.trace.note)
        self._service = LineService(
            master=self._master,
            port_name=opener.name,
            scheduler=self._scheduler,
            statistics=self._statistics,
            recovery=self._recovery,
            events=self.events,
        )
        self._time: Callable[[], float] = lambda: -inf
        self._is_open = False
        self._is_reopening = False  # after a reset on purpose: jobs wait for the new connection

    @property
    def progress(self) -> int:
        """Return a count that grows with each transaction, idle wake-up and attempt to open."""
        return self._service.steps

    async def run(self) -> None:
        """Serve this line until cancelled; a transaction whose request is sent then still runs to its end."""
        self._service.is_stopping = False
        serving = asyncio.create_task(self._serve(), name=f"line {self.name}")
        try:
            await asyncio.shield(serving)
        except asyncio.CancelledError:
            self._service.is_stopping = True
            if not self._master.is_on_wire:
                serving.cancel()
            await asyncio.wait([serving])
            raise

    def submit(self, job: Job) -> None:
        """Queue a job; without a port it ends at once, and when it waits for longer than it may."""
        if job.until_s < inf:
            asyncio.get_running_loop().call_at(job.until_s, self._expire, job)
        if self._is_open or self._is_reopening:
            self._scheduler.jobs.submit(job, self._time())
            self._service.wake()
        else:
            self.events.job_done(job, Silent("port closed", is_sent=False))
            self.events.flush()

    def withdraw(self, job: Job) -> bool:
        """Take a waiting job back, so that it is never sent; False when it is too late for that."""
        return self._service.withdraw(job)

    def _expire(self, job: Job) -> None:
        """End a job that still waits."""
        if self._scheduler.jobs.withdraw(job):
            self.events.job_done(job, Silent(TOO_LATE, is_sent=False))
            self.events.flush()

    def change(self, change: Callable[[Scheduler, float], object]) -> None:
        """Change what is asked, and how often; given the time."""
        change(self._scheduler, self._time())
        self._service.wake()

    def forget(self, unit: int) -> None:
        """Know nothing of a unit any more, whose polls are removed."""
        self.polls.forget(unit)
        self._master.forms.retry_refused(unit)
        self._statistics.forget(unit)

    def retry_refused(self, unit: int) -> None:
        """Ask again at once what a unit seemed to refuse, when another device answers there now."""
        self._master.forms.retry_refused(unit)
        self._service.wake()

    def statistics(self) -> dict[str, Any]:
        """Return the counters and times of this line."""
        statistics = self._statistics.to_dict(
            now_s=self._time(),
            more_of=lambda unit: {
                "state": self.polls.unit(unit).state,
                "late": self._master.forms.outstanding.came_late[unit],
            },
        )
        errors = self._opener.uart_errors() if isinstance(self._opener, CountsErrors) else None
        return {
            "is_open": self._is_open,
            **self.polls.statistics(self._time()),
            "progress": self.progress,
            "stray_bytes": self._master.strays.count,
            **({} if errors is None else {"uart_errors": errors}),
            **statistics,
        }

    async def _serve(self) -> None:
        """Serve as long as the line runs; end every job that waits."""
        self._time = asyncio.get_running_loop().time
        try:
            await self._keep_open()
        finally:
            self._end_jobs()

    async def _keep_open(self) -> None:
        """Open the port, serve, and reopen when it is lost, ever less often while that is no use."""
        backoff = Backoff(REOPEN_MIN_S, REOPEN_MAX_S)
        while True:
            self._service.steps += 1
            tried_s = self._time()
            try:
                port = await self._opener()
            except PortError as error:
                self._end_jobs()
                self.events.port_changed(str(error), is_open=False)
            else:
                await self._use(port)
            if self._service.is_stopping:
                return
            if self._is_reopening:
                continue
            if self._time() - tried_s > REOPEN_MAX_S:
                backoff.reset()
            await self._pause(backoff.next_s())

    async def _pause(self, pause_s: float) -> None:
        """Wait, and count on: a missing port must not look like a hang to what watches `progress`."""
        until_s = self._time() + pause_s
        while (left_s := until_s - self._time()) > 0:
            await asyncio.sleep(min(left_s, IDLE_WAKE_S))
            self._service.steps += 1

    async def _use(self, port: Port) -> None:
        """Serve on an open port until it is lost or we stop; leave it closed.

        After our own reset the jobs wait for the new connection, and nothing is published of it.
        """
        self._is_open, self._is_reopening = True, False
        self._master.use(port)
        self.polls.begin(self._time())
        self._statistics.begin(self._time())
        self._recovery.begin()
        try:
            if self._recovery.is_deaf:
                self.polls.expedite_all(self._time())
            else:
                self.events.port_changed("open", is_open=True)
            await asyncio.create_task(self._service.run(), name=f"serve {self.name}")
        except PortResetError as error:
            logger.info("line=%s %s", self.name, error)
            self._is_reopening = True
        except PortLostError as error:
            self.events.port_changed(str(error), is_open=False)
        finally:
            self._is_open = self._master.is_on_wire = False
            port.close()
            if not self._is_reopening:
                self._end_jobs()

    def _end_jobs(self) -> None:
        self._is_reopening = False
        for job in self._scheduler.jobs.clear():
            self.events.job_done(job, Silent("port closed", is_sent=False))
        self.events.flush()
