"""The way of one command, or stop, to its starter: requests and readings; it can be halted at any moment."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Coroutine, Iterable, Mapping
from contextlib import suppress
from math import inf
from typing import Any, TypeVar, assert_never

from gateway.contract import CommandError, Note, Reason, ResultCode
from gateway.errors import GatewayError
from gateway.families import Expect, Profile, Read, decode, reading
from gateway.line import Answered, Garbled, Outcome, Priority, Refused, Silent
from gateway.modbus import ExceptionCode, Request
from gateway.starters.command.addressee import StopAddressee
from gateway.starters.starter import StarterTelemetry

T = TypeVar("T")

DECIDES_FOR_S = 2.0  # what was read; after that much can have happened at a motor
READ_BACK_PAUSE_S = 0.1
LAST_READING_S = 0.5  # so long after a deadline the reading under way, or the second of two, is waited for
EQUAL_READINGS = 2  # that must follow one another: a CRC lets one bad frame in some 50,000 pass

Rows = dict[str, tuple[int, ...]]


class HaltedError(GatewayError):
    """The command was cut short; `reason` says why."""

    def __init__(self, reason: Reason) -> None:
        self.reason = reason
        super().__init__(reason.text)


class OverdueError(GatewayError):
    """The command's time is over."""


class RefusedError(CommandError):
    """The starter refused a request with a Modbus exception."""


class Wire:
    """Reads and writes of one starter for one command."""

    def __init__(
        self, starter: StarterTelemetry | StopAddressee, *, read_back_lane: Priority, until_s: float = inf
    ) -> None:
        self._starter = starter
        self._read_back_lane = read_back_lane
        self.until_s = until_s  # nothing is waited for any longer, whatever the line does
        self.now_s = asyncio.get_running_loop().time
        self._halted: Reason | None = None
        self._awaited: set[asyncio.Future[Any]] = set()
        self.seen_s = inf  # when the oldest of what was read last had been asked for; a write's answer counts

    def halt(self, reason: Reason) -> None:
        """Let nothing more go out.

        What waits for the line is withdrawn before anything that the caller hands to the line from now on.
        """
        self._halted = self._halted or reason
        for awaited in tuple(self._awaited):
            awaited.cancel()

    def hand_over(self, request: Request, *, lane: Priority) -> asyncio.Future[Outcome]:
        """Hand a request to the line at once; what is to become of it is cancelled when halted."""
        return self._until_halted(self._starter.ask(request, lane=lane))

    async def write(self, request: Request, *, lane: Priority, until_s: float = inf) -> Outcome:
        """Send a write once, not later than `until_s`; HaltedError, OverdueError: perhaps it went out."""
        outcome = await self._transact(request, lane, until_s=until_s)
        if isinstance(outcome, Answered):
            self.seen_s = _asked_s(outcome)
        return outcome

    async def read(self, reads: Iterable[Read], *, lane: Priority) -> Rows:
        """Return freshly read rows; CommandError without an answer or, as RefusedError, when refused."""
        rows: Rows = {}
        self.seen_s = inf
        for read in reads:
            rows |= self._rows_from(read, await self._transact(read.request, lane))
        return rows

    async def read_back(self, reads: Iterable[Read]) -> Rows | None:
        """Return freshly read rows for a read-back; None when a part of them could not be had in time."""
        try:
            return await self.read(reads, lane=self._read_back_lane)
        except (CommandError, OverdueError):
            return None  # or the family that is spoken to now does not have such a row

    async def see(self, expect: Expect) -> dict[str, Any] | None:
        """Return the values of two readings in a row that show what is expected; None when its time is up."""
        until_s = self.now_s() + expect.within_s
        count = 0
        with suppress(OverdueError):
            while True:
                values = self.values(await self.read_back(expect.reads) or {})
                count = count + 1 if expect.is_met(values) else 0
                if count == EQUAL_READINGS:
                    await asyncio.sleep(0)  # they are published before the result that rests on them
                    return values
                if count == 0 and self.now_s() >= until_s:
                    break
                await self.wait_for(asyncio.sleep(READ_BACK_PAUSE_S))
        return None

    async def is_refused(self, reads: Iterable[Read], codes: Collection[int]) -> bool:
        """Return whether the starter refuses to let any of these rows be read, each time with such a code."""
        requests = [read.request for read in reads for _ in range(EQUAL_READINGS)]
        outcomes = [await self._transact(request, self._read_back_lane) for request in requests]
        return all(isinstance(outcome, Refused) and outcome.code in codes for outcome in outcomes)

    def values(self, rows: Mapping[str, tuple[int, ...]]) -> dict[str, Any]:
        """Return what rows say: points by name, and the raw words by code."""
        decoded = decode.decode_points(self._starter.profile, self._starter.variant, rows)
        return {**rows, **{name: point.value for name, point in decoded.items()}}

    async def wait_for(self, work: Coroutine[Any, Any, object]) -> None:
        """Wait for something other than the starter, or for some time, unless halted."""
        await self._do(asyncio.ensure_future(work))

    def demand_not_halted(self) -> None:
        """Raise HaltedError when nothing more may go out."""
        if self._halted is not None:
            raise HaltedError(self._halted)

    async def _transact(self, request: Request, lane: Priority, *, until_s: float = inf) -> Outcome:
        self.demand_not_halted()
        if self.now_s() >= self.until_s:
            raise OverdueError
        return await self._do(self._starter.ask(request, lane=lane, until_s=until_s))

    def _rows_from(self, read: Read, outcome: Outcome) -> Rows:
        match outcome:
            case Answered():
                rows = reading.rows_in(self._starter.profile, read, outcome.value)
                self.seen_s = min(self.seen_s, _asked_s(outcome))
                self._starter.take_rows(rows, at_s=outcome.at_s)
                return rows
            case Refused():
                raise RefusedError(refusal_of(self._starter.profile, outcome.code, read.codes))
            case Silent(is_sent=False) | Garbled(is_sent=False):
                raise CommandError(ResultCode.LINE_DOWN, "read", reason=outcome.reason)
            case Silent() | Garbled():
                raise CommandError(ResultCode.NO_ANSWER, "status", reason=outcome.reason)
            case _:
                assert_never(outcome)

    def _until_halted(self, awaited: asyncio.Future[T]) -> asyncio.Future[T]:
        if self._halted is not None:
            awaited.cancel()
        self._awaited.add(awaited)
        awaited.add_done_callback(self._awaited.discard)
        return awaited

    async def _do(self, inner: asyncio.Future[T]) -> T:
        self._until_halted(inner)
        left_s = self.until_s - self.now_s()
        try:
            await asyncio.wait((inner,), timeout=None if left_s == inf else max(left_s, 0.0))
        finally:
            inner.cancel()  # does nothing to what is done; else it is overdue, or we are cancelled
        await asyncio.wait((inner,))
        if inner.cancelled():
            raise OverdueError if self._halted is None else HaltedError(self._halted)
        return inner.result()


def points_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the points of what rows say, without the raw words."""
    return {name: value for name, value in values.items() if not isinstance(value, tuple)}


def refusal_of(profile: Profile, number: int, codes: Iterable[str] = ()) -> Reason:
    """Return why a write, or the reading of these rows, was refused: by this Modbus exception."""
    code, rows, cause = exception_result(number), ", ".join(codes), profile.exceptions.get(number)
    reason = Reason(code, "read", number=number, rows=rows) if rows else Reason(code, "write", number=number)
    return reason.noted(None if cause is None else Note("cause", cause=cause))


def exception_result(number: int) -> ResultCode:
    """Return the result code that is named as this Modbus exception [APP 7]."""
    name = ExceptionCode(number).name if number in list(ExceptionCode) else ""
    return ResultCode.__members__.get(name, ResultCode.EXCEPTION)


def _asked_s(answer: Answered) -> float:
    """Return when an answer was asked for (its request's end), however late it was taken from the port."""
    return answer.at_s - answer.response_time_s
