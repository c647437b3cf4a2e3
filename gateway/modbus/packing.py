"""Packing of data in PDUs.

Coils: the first one is the lowest bit of the first byte [APP 6.1, 6.11]. Replies that consist of registers:
byte count and words, high byte first [APP 4.2, 6.3, 6.4, 6.17].
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from gateway.modbus.pdu import Request, check_words, mismatch


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


def decode_words(request: Request, pdu: bytes, *, count: int) -> tuple[int, ...]:
    """Return the words of a reply to this request; BadReplyError unless there are exactly `count`."""
    size = 2 * count
    if pdu[:2] != bytes((request.function, size)) or len(pdu) != 2 + size:
        raise mismatch(request, pdu)
    return struct.unpack_from(f">{count}H", pdu, 2)


def encode_words(request: Request, words: Sequence[int], *, count: int) -> bytes:
    """Return the reply PDU to this request; ValueError unless it is given `count` words."""
    if len(words) != count:
        raise ValueError(f"{len(words)} words for a request of {count}")
    check_words(words)
    return struct.pack(f">BB{count}H", request.function, 2 * count, *words)
