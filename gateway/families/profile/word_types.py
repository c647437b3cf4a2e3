"""Words on the wire and what they carry: whole numbers, dates, addresses, texts, versions.

How the bytes of a text lie in its words is not stated (ssw900 table A.3, SST). The natural reading is tried
first, the other byte order next; what is plausible in neither is None, and the raw words stand beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from decimal import Decimal
from ipaddress import IPv4Address

from gateway.families.profile.rows import Parameter, Type

_BYTE = (0, 0xFF)
_WORD = (0, 0xFFFF)
_LONG = (0, 0xFFFF_FFFF)

# The range of each type; types that are no numbers are not in it.
TYPE_LIMITS: dict[Type, tuple[int, int]] = {
    Type.U8: _BYTE,
    Type.LOW_U8: _BYTE,
    Type.LOW_S8: (-0x80, 0x7F),
    Type.LOW_ENUM: _BYTE,
    Type.U16: _WORD,
    Type.S16: (-0x8000, 0x7FFF),
    Type.ENUM: _WORD,
    Type.BITS: _WORD,
    Type.BIT: (0, 1),
    Type.U32: _LONG,
    Type.S32: (-0x8000_0000, 0x7FFF_FFFF),
    Type.TIME: _LONG,
}

LOW_BYTE = frozenset({Type.LOW_U8, Type.LOW_S8, Type.LOW_ENUM})


def from_words(row: Parameter, words: Sequence[int]) -> int:
    """Return the number in these words; it may be one that the type cannot carry (U8 with a high byte)."""
    number = sum(word << (16 * place) for place, word in enumerate(words))
    width = 16 * len(words)
    if row.type in LOW_BYTE:  # the SST's high byte says nothing
        number, width = number & 0xFF, 8
    is_negative = TYPE_LIMITS[row.type][0] < 0 and number >> (width - 1)
    return number - (1 << width) if is_negative else number


def to_percent(number: int, full_scale: int) -> float:
    """Return a raw number in per cent: the shortest figure that `of_percent` makes the same number of.

    8191 of 16383 is 50.0, as the manual's example has it (ssw06-es 5.4.6).
    """
    for decimals in range(4):
        steps = 100 * 10**decimals
        figure = -(-number * steps // full_scale)  # rounded up: the way back rounds down
        if figure * full_scale // steps == number:
            return float(figure / 10**decimals)
    return number * 100 / full_scale


def of_percent(percent: Decimal, full_scale: int) -> int:
    """Return the raw number for so many per cent; half a step is rounded down (ssw06-es 5.4.6)."""
    return math.floor(percent * full_scale / 100)


def to_number_words(row: Parameter, number: int) -> tuple[int, ...]:
    """Return the words that carry a number within the row's limits."""
    pattern = number & (0xFF if row.type in LOW_BYTE else (1 << (16 * row.words)) - 1)
    return tuple((pattern >> (16 * place)) & 0xFFFF for place in range(row.words))


_FIRST_YEAR, _LAST_YEAR = 2000, 2099  # of a plausible clock


def to_text(kind: Type, words: Sequence[int]) -> str | None:
    """Return a date (ISO), an address or a string; None when the words are no plausible one."""
    read = _READERS[kind]
    text = read(words)
    return text if text is not None else read([_swapped(word) for word in words])


SPELT: dict[Type, str] = {
    Type.DATE: "a date and time such as 2026-11-22T05:30:00",
    Type.IP_ADDRESS: "an address such as 192.168.0.10",
    Type.STRING: "plain characters",
}


def from_text(kind: Type, text: str, *, words: int, longest: int) -> tuple[int, ...] | None:
    """Return the words of a text in the natural byte order; None when it is no such text.

    `longest` is how many characters a string may have; one has at least one.
    """
    if kind is Type.DATE:
        return _date_words(text)
    if kind is Type.IP_ADDRESS:
        return _ip_words(text)
    if not (1 <= len(text) <= longest and text.isascii() and text.isprintable()):
        return None
    octets = text.encode("ascii").ljust(2 * words, b"\0")
    return tuple(octets[at] << 8 | octets[at + 1] for at in range(0, 2 * words, 2))


def in_order_of(kind: Type, words: tuple[int, ...], seen: Sequence[int]) -> tuple[int, ...]:
    """Return words with their bytes as the starter has them: swapped if only that makes sense of `seen`."""
    read = _READERS[kind]
    is_swapped = read(seen) is None and read([_swapped(word) for word in seen]) is not None
    return tuple(_swapped(word) for word in words) if is_swapped else words


def shown_within(kind: Type, words: tuple[int, ...], seconds: int) -> tuple[tuple[int, ...], ...]:
    """Return what may be read back so many seconds after this was written: a clock goes on."""
    text = to_text(kind, words) if kind is Type.DATE else None
    if text is None:
        return (words,)
    start = datetime.fromisoformat(text)
    later = (_date_words((start + timedelta(seconds=past)).isoformat()) for past in range(seconds + 1))
    return tuple(in_order_of(kind, each, words) for each in later if each is not None)


def _date_words(text: str) -> tuple[int, ...] | None:
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        return None
    if when.tzinfo is not None or not _FIRST_YEAR <= when.year <= _LAST_YEAR:
        return None
    return when.minute << 8 | when.second, when.day << 8 | when.hour, when.month, when.year


def _ip_words(text: str) -> tuple[int, ...] | None:
    try:
        number = int(IPv4Address(text))
    except ValueError:
        return None
    return number & 0xFFFF, number >> 16


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
    return str(IPv4Address(words[0] | words[1] << 16))


def _mac_address(words: Sequence[int]) -> str | None:
    """Six octets, the low byte of the first word first; a station's own address begins with an even one."""
    octets = [octet for word in words for octet in (word & 0xFF, word >> 8)]
    return None if octets[0] & 1 else ":".join(f"{octet:02X}" for octet in octets)


def _string(words: Sequence[int]) -> str | None:
    """Characters, high byte first, filled up with 0."""
    octets = bytes(octet for word in words for octet in (word >> 8, word & 0xFF))
    text = octets.rstrip(b"\0").decode("latin-1")
    return text if text.isascii() and text.isprintable() else None


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


def text_of(words: Sequence[int], begins: str) -> str | None:
    """Return a text over several rows, whichever byte comes first: the order is not stated (SST 22-29)."""
    for order in ("big", "little"):
        octets = b"".join(word.to_bytes(2, order) for word in words)
        text = octets.split(b"\0", 1)[0].decode("latin-1").rstrip()
        if text.startswith(begins) and text.isascii() and text.isprintable():
            return text
    return None


def version_of(words: Sequence[int], _begins: str = "") -> str:
    """Return the version in two rows: 0204h, 0001h is 4.21 (SST 2-3, erratum E-14)."""
    return f"{words[0] & 0xFF}.{words[0] >> 8}{words[1] & 0xFF}"


def serial_of(words: Sequence[int], _begins: str = "") -> str | None:
    """Return the serial number: 32 bits in the first two rows, or 64 when the others are used (SST 8-11)."""
    used = words if any(words[2:]) else words[:2]
    number = int.from_bytes(b"".join(word.to_bytes(2, "big") for word in used), "big")
    return str(number) if number else None


JOINS: dict[str, Callable[[Sequence[int], str], str | None]] = {
    "text": text_of,
    "version": version_of,
    "serial": serial_of,
}
