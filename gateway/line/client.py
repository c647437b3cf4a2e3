"""The requests that the app may make of a line."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from math import inf
from typing import Any

from gateway.line.line import Line
from gateway.line.rtu.transaction import Outcome, Silent
from gateway.line.scheduler.requests import Job, Poll, Priority
from gateway.line.scheduler.scheduler import Scheduler
from gateway.modbus import LineTiming, Request

Post = Callable[..., bool]  # post(call, *args): call it on the line's loop, in order; False: it has ended


class LineClient:
    """One line, from the app's loop: `post` carries each call to the line's loop."""

    def __init__(self, line: Line, post: Post, statistics: Callable[[], dict[str, Any]]) -> None:
        self._line = line
        self._post = post
        self._statistics = statistics
        self.stop_bound_s: float | None = None  # the computed wait of a stop, from the app's forecast

    @property
    def name(self) -> str:
        """The line's name in the configuration."""
        return self._line.name

    @property
    def timing(self) -> LineTiming:
        """The line's rate and framing, and the silences that follow from them."""
        return self._line.timing

    def transact(
        self,
        unit: int,
        request: Request,
        *,
        response_time_s: float,
        lane: Priority,
        until_s: float = inf,
    ) -> asyncio.Future[Outcome]:
        """Hand a request to the line now, to be sent once, and return what is to become of it.

        Cancelled before it is sent, it never is; nor is it after `until_s` on the steady clock: it then ends
        as `Silent(TOO_LATE, is_sent=False)`. So does a write but a stop's while an earlier reply of its unit
        may still come, and a read that would prove that none can is not answered either.
        """
        pending = _Pending(lambda: self._post(self._line.withdraw, job))
        job = Job(unit, request, response_time_s, lane, pending.settle, until_s)
        if not self._post(self._line.submit, job):
            pending.settle(Silent("port closed", is_sent=False))
        return pending

    def add_poll(self, poll: Poll) -> None:
        """Repeat a request from now on; its key must be new on this line."""
        self._change(lambda scheduler, now_s: scheduler.polls.add(poll, now_s))

    def remove_poll(self, key: str) -> None:
        """End this poll; an answer under way is not published any more."""
        self._change(lambda scheduler, _: scheduler.polls.remove(key))

    def set_every(self, key: str, every_s: float) -> None:
        """Change a poll's period; a shorter one takes effect at once."""
        self._change(lambda scheduler, now_s: scheduler.polls.set_every(key, every_s, now_s))

    def expedite(self, key: str) -> None:
        """Make a poll due now."""
        self._change(lambda scheduler, now_s: scheduler.polls.expedite(key, now_s))

    def set_deadline(self, unit: int, seconds: float | None) -> None:
        """See to it that a unit is reached within its watchdog's time; None or 0: it has none."""
        self._change(lambda scheduler, _: scheduler.polls.set_deadline(unit, seconds))

    def expect_silence(self, unit: int, seconds: float) -> None:
        """Count no misses of this unit for so long: it restarts, and the gateway knows why."""
        self._change(lambda scheduler, now_s: scheduler.polls.unit(unit).expect_silence(now_s + seconds))

    def forget(self, unit: int) -> None:
        """Know nothing of a unit any more, once its polls are removed: it is gone, or another one now."""
        self._post(self._line.forget, unit)

    def retry_refused(self, unit: int) -> None:
        """Ask again at once what a unit seemed to refuse: another device answers there now."""
        self._post(self._line.retry_refused, unit)

    def statistics(self) -> dict[str, Any]:
        """Return the line's counters and times for `B/gateway/line/{line}`, at most about a second old."""
        found = self._statistics()
        stops = {"computed": self.stop_bound_s, **found.get("stop_latency_s", {})}
        return {**found, "stop_latency_s": stops} if found else found

    @property
    def stretch(self) -> float:
        """The factor by which all periods are stretched at present, since the line has no time for all."""
        return self._line.polls.stretch

    def _change(self, change: Callable[[Scheduler, float], object]) -> None:
        self._post(self._line.change, change)


class _Pending(asyncio.Future[Outcome]):
    """An outcome to come; to cancel it withdraws the request before anything else is done."""

    def __init__(self, withdraw: Callable[[], object]) -> None:
        super().__init__(loop=asyncio.get_running_loop())
        self._withdraw = withdraw

    def settle(self, outcome: Outcome) -> None:
        """Set its outcome, unless it was cancelled."""
        self._withdraw = _nothing  # or job and outcome hold each other until a whole garbage collection
        if not self.done():
            self.set_result(outcome)

    def cancel(self, msg: Any = None) -> bool:
        """Take the request back; asyncio calls this for the task that waits."""
        is_cancelled = super().cancel(msg)
        if is_cancelled:
            self._withdraw()
            self._withdraw = _nothing
        return is_cancelled


def _nothing() -> None:
    """Withdraw what has ended."""
