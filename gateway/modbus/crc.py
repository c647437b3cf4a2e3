"""The check of an RTU frame [SERIAL 2.5.1.2]."""

from __future__ import annotations

_POLYNOMIAL = 0xA001  # x^16 + x^15 + x^2 + 1, bits reversed [SERIAL 6.2.2]
_START = 0xFFFF


def crc16(data: bytes) -> int:
    """Return the CRC-16 of `data`; it goes on the wire low byte first."""
    crc = _START
    for byte in data:
        crc = (crc >> 8) ^ _TABLE[(crc ^ byte) & 0xFF]
    return crc


def _remainder(byte: int) -> int:
    for _ in range(8):
        byte = (byte >> 1) ^ (_POLYNOMIAL if byte & 1 else 0)
    return byte


# Computed, not copied: the tables printed in the SSW-07 manual have lost rows (ssw07-ssw08 appendix A).
_TABLE = tuple(_remainder(byte) for byte in range(256))
