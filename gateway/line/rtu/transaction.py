"""One transaction: how long it takes at most, and its outcome.

Silence, garbage and exception replies are values, not errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gateway.modbus import MAX_ADU_SIZE, ExceptionCode, LineTiming, Request

ALLOWANCE_S = 0.02  # for adapters, drivers and this machine, on top of the unit's own response time

_ADU_EXTRA = 3  # bytes around a PDU: unit and CRC
TOO_LATE = "it has become too late"  # the reason of a job that is not sent any more

_LASTING = frozenset(
    {
        ExceptionCode.ILLEGAL_FUNCTION,
        ExceptionCode.ILLEGAL_DATA_ADDRESS,
        ExceptionCode.ILLEGAL_DATA_VALUE,
        ExceptionCode.SERVER_DEVICE_FAILURE,
    }
)


def request_wire_s(request: Request, timing: LineTiming) -> float:
    """Return how long the request is on the wire."""
    return timing.wire_s(len(request.encode()) + _ADU_EXTRA)


def reply_within_s(
    request: Request, timing: LineTiming, *, response_time_s: float, allowance_s: float
) -> float:
    """Return how long after the request's end its reply is waited for, at most."""
    size = request.reply_size()
    reply_s = timing.wire_s(MAX_ADU_SIZE if size is None else size + _ADU_EXTRA)
    return response_time_s + reply_s + allowance_s


def longest_s(
    request: Request, timing: LineTiming, *, response_time_s: float, allowance_s: float = ALLOWANCE_S
) -> float:
    """Return how long this request can keep others from the line: no reply, then listening for a late one."""
    within_s = reply_within_s(request, timing, response_time_s=response_time_s, allowance_s=allowance_s)
    return request_wire_s(request, timing) + within_s + max(response_time_s, timing.silence_s)


@dataclass(frozen=True, slots=True)
class Answered:
    """The unit gave the reply that was asked for."""

    value: Any  # what the request's `decode_reply` returns
    at_s: float  # when the reply's last byte left the wire, on the line's clock
    response_time_s: float  # from the request's last byte to the reply's first
    is_over_babble: bool = False  # a stop that was sent although the line was never quiet


@dataclass(frozen=True, slots=True)
class Refused:
    """The unit answered with a Modbus exception [APP 7]."""

    code: int
    at_s: float
    is_over_babble: bool = False

    @property
    def is_lasting(self) -> bool:
        """Whether the unit will say the same the next time [APP 7]."""
        return self.code in _LASTING


@dataclass(frozen=True, slots=True)
class Silent:
    """Nothing came before the deadline; after a write this says nothing about success."""

    reason: str = "no reply"  # "port lost" and "port closed" too; is_sent says whether the request went out
    is_sent: bool = True
    is_over_babble: bool = False


@dataclass(frozen=True, slots=True)
class Garbled:
    """Something came that is not the reply: bad CRC, another unit, another function, a wrong length."""

    reason: str
    received: bytes
    is_sent: bool = True
    is_over_babble: bool = False


Outcome = Answered | Refused | Silent | Garbled
