"""What upper floors may ask of a line, from the app's loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from math import inf
from typing import Any, Protocol

from gateway.line.line import Line
from gateway.line.rtu.outcome import Outcome
from gateway.line.scheduler.requests import Job, Poll, Priority
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

    def transact(
        self, unit: int, request: Request, *, response_time_s: float, lane: Priority, until_s: float = inf
    ) -> asyncio.Future[Outcome]:
        """Hand a request to the line now, to be sent once, and return what is to become of it.

        Cancelled before it is sent, it never is; nor is it after `until_s` on the steady clock: it then ends
        as `Silent(TOO_LATE, is_sent=False)`.
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


class _Asked(asyncio.Future[Outcome]):
    """An outcome to come; who cancels it has withdrawn the request before doing anything else."""

    def __init__(self, withdraw: Callable[[], None]) -> None:
        super().__init__(loop=asyncio.get_running_loop())
        self._withdraw = withdraw

    def settle(self, outcome: Outcome) -> None:
        """Tell what became of it, unless nobody waits any more."""
        if not self.done():
            self.set_result(outcome)

    def cancel(self, msg: Any = None) -> bool:
        """Take the request back; asyncio calls this for whoever waits."""
        is_cancelled = super().cancel(msg)
        if is_cancelled:
            self._withdraw()
        return is_cancelled


def settled(outcome: Outcome) -> asyncio.Future[Outcome]:
    """Return an outcome that is known already."""
    future: asyncio.Future[Outcome] = asyncio.get_running_loop().create_future()
    future.set_result(outcome)
    return future


class LocalLineClient:
    """A LineClient of a scheduler that runs on the same loop."""

    def __init__(self, scheduler: Line) -> None:
        self._scheduler = scheduler

    @property
    def name(self) -> str:
        """The line's name in the configuration."""
        return self._scheduler.name

    @property
    def timing(self) -> LineTiming:
        """The line's rate and framing."""
        return self._scheduler.timing

    def transact(
        self, unit: int, request: Request, *, response_time_s: float, lane: Priority, until_s: float = inf
    ) -> asyncio.Future[Outcome]:
        """Hand a request to the line now, to be sent once; when cancelled before it is sent, it never is."""
        asked = _Asked(lambda: self._to_line(lambda: self._scheduler.withdraw(job)))
        job = Job(
            unit,
            request,
            response_time_s,
            lane,
            lambda outcome: self._to_app(lambda: asked.settle(outcome)),
            until_s,
        )
        self._to_line(lambda: self._scheduler.submit(job))
        return asked

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
