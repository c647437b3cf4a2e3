"""Reads many rows of one starter: what is refused is asked for in halves, until the row is found."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import assert_never

from gateway.contract import CommandError, ResultCode
from gateway.errors import PortLostError
from gateway.families import Profile, Read, reading
from gateway.line import Answered, Garbled, Outcome, Refused, Silent
from gateway.modbus import ExceptionCode, Request, exception_name

LONGEST_BLOCK = 24  # registers: no request of an identification is shorter, so no stop waits longer
TRIES = 3  # of a request that is not answered, or to which the starter is too busy

Ask = Callable[[Request], Awaitable[Outcome]]

_PASSING = (ExceptionCode.ACKNOWLEDGE, ExceptionCode.SERVER_DEVICE_BUSY)


@dataclass(slots=True)
class BulkReading:
    """What was read; `refused` says by code what the starter said to the others."""

    rows: dict[str, tuple[int, ...]] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)


@lru_cache(maxsize=512)  # the starters of a family are asked for the same rows, and share their requests
def short_reads(profile: Profile, codes: tuple[str, ...]) -> tuple[Read, ...]:
    """Return the requests for rows that are read while everything else goes first."""
    return reading.bulk_reads(profile, codes, longest=min(LONGEST_BLOCK, profile.limits.read_registers // 2))


async def read_in_bulk(
    ask: Ask,
    profile: Profile,
    reads: Iterable[Read],
    *,
    tries: int = TRIES,
) -> BulkReading:
    """Carry out these reads.

    Beside polls `tries` is 1: two misses in a row make a unit count as silent.
    CommandError("no_answer") when the starter does not answer, PortLostError when the port is gone.
    """
    found = BulkReading()
    waiting = [*reads][::-1]  # the next one last
    while waiting:
        read = waiting.pop()
        outcome = await _answered(ask, read, tries=tries)
        if isinstance(outcome, Answered):
            found.rows |= reading.rows_in(profile, read, outcome.value)
        else:
            smaller = reading.halves(profile, read)
            waiting += reversed(smaller)
            if not smaller:
                found.refused |= dict.fromkeys(read.codes, exception_name(outcome.code))
    return found


async def _answered(ask: Ask, read: Read, *, tries: int) -> Answered | Refused:
    reason = ""
    for _ in range(tries):
        outcome = await ask(read.request)
        match outcome:
            case Answered():
                return outcome
            case Refused():
                if outcome.code not in _PASSING:
                    return outcome
                reason = exception_name(outcome.code)
            case Silent(is_sent=False) | Garbled(is_sent=False):
                raise PortLostError("of the line", outcome.reason)
            case Silent() | Garbled():
                reason = outcome.reason
            case _:
                assert_never(outcome)
    raise CommandError(ResultCode.NO_ANSWER, "rows", rows=_span(read), reason=reason)


def _span(read: Read) -> str:
    first, last = read.codes[0], read.codes[-1]
    return first if first == last else f"{first} to {last}"
