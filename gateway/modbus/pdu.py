"""The common part of all requests: shape, limits, exception reply, how bits are packed [APP 4, 7].

Coils: the first one is the lowest bit of the first byte [APP 6.1, 6.11].
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Protocol

from gateway.errors import BadReplyError
from gateway.modbus.codes import EXCEPTION_BIT

MAX_PDU_SIZE = 253  # bytes [APP 4.1]
ADDRESS_SPACE = 0x10000  # addresses of each table are 0..65535 [APP 4.4]

_SHOWN_BYTES = 32  # of a reply that does not fit, in an error's text


class Request(Protocol):
    """One request to one unit; immutable, so that it can be built once and sent many times."""

    @property
    def function(self) -> int:
        """The function code."""

    @property
    def is_write(self) -> bool:
        """Whether it changes anything in the unit, so that silence leaves its success open."""

    def encode(self) -> bytes:
        """Return the request PDU."""

    def decode_reply(self, pdu: bytes) -> Any:
        """Return what the reply says; BadReplyError unless it answers exactly this request."""

    def reply_size(self) -> int | None:
        """Return the length of the normal reply PDU; None when only the reply contains it."""


def exception_code(request: Request, pdu: bytes) -> int | None:
    """Return the code when `pdu` is the exception reply to this request, else None [APP 7]."""
    if len(pdu) == 2 and pdu[0] == request.function | EXCEPTION_BIT:
        return pdu[1]
    return None


def encode_exception(function: int, code: int) -> bytes:
    """Return the exception reply PDU to a request of this function [APP 7]."""
    return bytes((function | EXCEPTION_BIT, code))


def mismatch(request: Request, pdu: bytes) -> BadReplyError:
    """Return the error for a PDU that does not answer this request."""
    more = " .." if len(pdu) > _SHOWN_BYTES else ""
    shown = pdu[:_SHOWN_BYTES].hex(" ") or "nothing"
    return BadReplyError(f"not the reply to this request of function {request.function}: {shown}{more}")


def check_run(address: int, count: int, *, max_count: int) -> None:
    """Raise ValueError unless a request may name `count` things from `address` on."""
    if not 1 <= count <= max_count:
        raise ValueError(f"count {count} is not in 1..{max_count}")
    if not (address >= 0 and address + count <= ADDRESS_SPACE):
        raise ValueError(f"addresses {address}..{address + count - 1} are not in 0..{ADDRESS_SPACE - 1}")


def check_words(words: Iterable[int]) -> None:
    """Raise ValueError unless every number fits a 16-bit register."""
    for word in words:
        if not 0 <= word <= 0xFFFF:
            raise ValueError(f"{word} does not fit a register (0..65535)")


def byte_count(bit_count: int) -> int:
    """Return how many bytes hold so many bits."""
    return (bit_count + 7) // 8


def pack_bits(bits: Sequence[bool]) -> bytes:
    """Return the bits in bytes; the last byte is filled up with zeros."""
    number = sum(1 << place for place, bit in enumerate(bits) if bit)
    return number.to_bytes(byte_count(len(bits)), "little")


def unpack_bits(packed: bytes, bit_count: int) -> tuple[bool, ...]:
    """Return the first `bit_count` bits; what fills up the last byte is ignored."""
    number = int.from_bytes(packed, "little")
    return tuple(bool(number >> place & 1) for place in range(bit_count))
