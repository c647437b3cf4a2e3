"""What upper floors may ask of a line, from the app's loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from math import inf
from typing import Any, Protocol

from gateway.line.job import Job, Lane, Poll
from gateway.line.outcome import Outcome
from gateway.line.scheduler import Scheduler
from gateway.modbus.pdu import Request
from gateway.modbus.timing import LineTiming


class LineClient(Protocol):
    """One line, as the floor above sees it; every method belongs to the app's loop."""

    @property
    def name(self) -> str:
        """The line's name in the configuration."""
        ...

    @property
    def timing(self) -> LineTiming:
        """The line's rate and framing, and the silences that follow from them."""
        ...

    async def transact(
        self, unit: int, request: Request, *, response_time_s: float, lane: Lane, until_s: float = inf
    ) -> Outcome:
        """Send a request once and return what became of it; when cancelled before it is sent, it never is.

        Nor is it after `until_s` on the steady clock: it then ends as `Silent(TOO_LATE, is_sent=False)`.
        """
        ...

    def add_poll(self, poll: Poll) -> None:
        """Repeat a request from now on; its key must be new on this line."""
        ...

    def remove_poll(self, key: str) -> None:
        """Ask no more; an answer under way is not told any more."""
        ...

    def set_every(self, key: str, every_s: float) -> None:
        """Change a poll's period; a shorter one takes effect at once."""
        ...

    def hasten(self, key: str) -> None:
        """Make a poll due now."""
        ...

    def set_deadline(self, unit: int, seconds: float | None) -> None:
        """See to it that a unit is reached within its watchdog's time; None or 0: it has none."""
        ...

    def expect_silence(self, unit: int, seconds: float) -> None:
        """Count no misses of this unit for so long: it restarts, and the gateway knows why."""
        ...

    def forget(self, unit: int) -> None:
        """Know nothing of a unit any more, once its polls are removed: it is gone, or another one now."""
        ...

    def figures(self) -> dict[str, Any]:
        """Return the line's counters and times for `B/gateway/line/{line}`, at most about a second old."""
        ...


class LocalLineClient:
    """A LineClient of a scheduler that runs on the same loop."""

    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler = scheduler

    @property
    def name(self) -> str:
        """The line's name in the configuration."""
        return self._scheduler.name

    @property
    def timing(self) -> LineTiming:
        """The line's rate and framing."""
        return self._scheduler.timing

    async def transact(
        self, unit: int, request: Request, *, response_time_s: float, lane: Lane, until_s: float = inf
    ) -> Outcome:
        """Send a request once and return what became of it; when cancelled before it is sent, it never is."""
        future: asyncio.Future[Outcome] = asyncio.get_running_loop().create_future()

        def settle(outcome: Outcome) -> None:
            if not future.done():
                future.set_result(outcome)

        job = Job(
            unit,
            request,
            response_time_s,
            lane,
            lambda outcome: self._to_app(lambda: settle(outcome)),
            until_s,
        )
        self._to_line(lambda: self._scheduler.submit(job))
        try:
            return await future
        except asyncio.CancelledError:
            self._to_line(lambda: self._scheduler.withdraw(job))
            raise

    def add_poll(self, poll: Poll) -> None:
        """Repeat a request from now on; its key must be new on this line."""
        self._to_line(lambda: self._scheduler.add_poll(poll))

    def remove_poll(self, key: str) -> None:
        """Ask no more."""
        self._to_line(lambda: self._scheduler.remove_poll(key))

    def set_every(self, key: str, every_s: float) -> None:
        """Change a poll's period."""
        self._to_line(lambda: self._scheduler.set_every(key, every_s))

    def hasten(self, key: str) -> None:
        """Make a poll due now."""
        self._to_line(lambda: self._scheduler.hasten(key))

    def set_deadline(self, unit: int, seconds: float | None) -> None:
        """See to it that a unit is reached within its watchdog's time."""
        self._to_line(lambda: self._scheduler.set_deadline(unit, seconds))

    def expect_silence(self, unit: int, seconds: float) -> None:
        """Count no misses of this unit for so long."""
        self._to_line(lambda: self._scheduler.expect_silence(unit, seconds))

    def forget(self, unit: int) -> None:
        """Know nothing of a unit any more."""
        self._to_line(lambda: self._scheduler.forget(unit))

    def figures(self) -> dict[str, Any]:
        """Return the line's counters and times."""
        return self._scheduler.figures()

    def _to_line(self, call: Callable[[], object]) -> None:
        """Have something done on the line's loop, in order."""
        call()

    def _to_app(self, call: Callable[[], object]) -> None:
        """Have something done on the app's loop, in order; called on the line's."""
        call()
