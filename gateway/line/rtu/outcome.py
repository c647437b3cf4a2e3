"""The outcome of one transaction. Silence, garbage and exception replies are values, not errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gateway.modbus import ExceptionCode

TOO_LATE = "it has become too late"  # the reason of a job that is not sent any more

_LASTING = frozenset(
    {
        ExceptionCode.ILLEGAL_FUNCTION,
        ExceptionCode.ILLEGAL_DATA_ADDRESS,
        ExceptionCode.ILLEGAL_DATA_VALUE,
        ExceptionCode.SERVER_DEVICE_FAILURE,
    }
)


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
