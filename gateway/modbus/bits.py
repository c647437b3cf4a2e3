"""Coils in bytes: the first coil is the lowest bit of the first byte [APP 6.1, 6.11]."""

from __future__ import annotations

from collections.abc import Sequence


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
