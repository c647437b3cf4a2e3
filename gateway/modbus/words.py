"""Replies that are nothing but registers: byte count and words, high byte first [APP 4.2, 6.3, 6.4, 6.17]."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from gateway.modbus.pdu import Request, check_words, mismatch


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
