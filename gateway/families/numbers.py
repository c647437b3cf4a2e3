"""Words on the wire and the whole number they carry: sign, low bytes, low word first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from decimal import Decimal

from gateway.families.schema import Parameter, Type

_BYTE = (0, 0xFF)
_WORD = (0, 0xFFFF)
_LONG = (0, 0xFFFF_FFFF)

# What each type can carry; types that are no numbers are not in it.
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

# How many words each type takes; a string takes what its row says.
TYPE_WORDS: dict[Type, int] = {
    **dict.fromkeys((*TYPE_LIMITS, Type.VERSION_LOW, Type.VERSION_HIGH), 1),
    Type.U32: 2,
    Type.S32: 2,
    Type.TIME: 2,
    Type.IP_ADDRESS: 2,
    Type.MAC_ADDRESS: 3,
    Type.DATE: 4,
}

_LOW_BYTE = frozenset({Type.LOW_U8, Type.LOW_S8, Type.LOW_ENUM})


def from_words(row: Parameter, words: Sequence[int]) -> int:
    """Return the number in these words; it may be one that the type cannot carry (U8 with a high byte)."""
    number = sum(word << (16 * place) for place, word in enumerate(words))
    width = 16 * len(words)
    if row.type in _LOW_BYTE:  # the SST's high byte says nothing
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
    pattern = number & (0xFF if row.type in _LOW_BYTE else (1 << (16 * row.words)) - 1)
    return tuple((pattern >> (16 * place)) & 0xFFFF for place in range(row.words))
