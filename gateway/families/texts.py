"""Rows that are no numbers: dates, addresses and strings of the SSW900, names and versions of the SST.

How their bytes lie in the words is not stated (table A.3). The natural reading is tried first, the other byte
order next; what is plausible in neither is None, and the raw words stand beside it in any case.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import datetime

from gateway.families.schema import Type

_FIRST_YEAR, _LAST_YEAR = 2000, 2099  # of a plausible clock


def to_text(kind: Type, words: Sequence[int]) -> str | None:
    """Return a date (ISO), an address or a string; None when the words are no plausible one."""
    read = _READERS[kind]
    text = read(words)
    return text if text is not None else read([_swapped(word) for word in words])


def _swapped(word: int) -> int:
    return (word & 0xFF) << 8 | word >> 8


def _date(words: Sequence[int]) -> str | None:
    """Eight bytes: second, minute, hour, day, month, reserved, year; the low byte of a word first."""
    second, minute = words[0] & 0xFF, words[0] >> 8
    hour, day = words[1] & 0xFF, words[1] >> 8
    month, year = words[2] & 0xFF, words[3]
    if not _FIRST_YEAR <= year <= _LAST_YEAR:
        return None
    try:
        return datetime(year, month, day, hour, minute, second).isoformat()  # the starter's own zone
    except ValueError:
        return None


def _ip_address(words: Sequence[int]) -> str | None:
    """A 32-bit number, low word first; any number is an address."""
    number = words[0] | words[1] << 16
    return ".".join(str(number >> shift & 0xFF) for shift in (24, 16, 8, 0))


def _mac_address(words: Sequence[int]) -> str | None:
    """Six octets, the low byte of the first word first; a station's own address begins with an even one."""
    octets = [octet for word in words for octet in (word & 0xFF, word >> 8)]
    return None if octets[0] & 1 else ":".join(f"{octet:02X}" for octet in octets)


def _string(words: Sequence[int]) -> str | None:
    """Characters, high byte first, up to the first 0."""
    octets = bytes(octet for word in words for octet in (word >> 8, word & 0xFF))
    text = octets.split(b"\0", 1)[0].decode("latin-1")
    is_plausible = text.isascii() and text.isprintable() and (text or not any(words))
    return text if is_plausible else None


def _version_low(words: Sequence[int]) -> str:
    """0106h is 6.1."""
    return f"{words[0] & 0xFF}.{words[0] >> 8}"


def _version_high(words: Sequence[int]) -> str:
    """0101h is 1.01."""
    return f"{words[0] >> 8}.{words[0] & 0xFF:02d}"


_READERS: dict[Type, Callable[[Sequence[int]], str | None]] = {
    Type.DATE: _date,
    Type.IP_ADDRESS: _ip_address,
    Type.MAC_ADDRESS: _mac_address,
    Type.STRING: _string,
    Type.VERSION_LOW: _version_low,
    Type.VERSION_HIGH: _version_high,
}
