"""How long characters, frames and silences are on a line [SERIAL 2.5.1.1]."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Literal, Self, cast

# The starters count characters of 11 bits whatever the framing, and keep the times of 19200 bit/s above it
# (ssw06-es 5.2.5, ssw07 5.2.5, ssw900 table 2.2); the 1.75 ms of [SERIAL 2.5.1.1] are too short for them.
_COUNTED_BITS = 11
_FASTEST_COUNTED_BAUD = 19200

_FRAMING = re.compile(r"8([NEO])([12])", re.IGNORECASE)

Parity = Literal["N", "E", "O"]


@dataclass(frozen=True, slots=True)
class Framing:
    """The bits around the eight of a byte; RTU always has eight [SERIAL 2.5.1]."""

    parity: Parity
    stop_bits: Literal[1, 2]

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the framing written as 8E1, 8N2, 8O1 ...; ValueError for any other text."""
        match = _FRAMING.fullmatch(text)
        if match is None:
            raise ValueError(f"framing {text!r} is not one of 8N1, 8E1, 8O1, 8N2, 8E2, 8O2")
        return cls(cast(Parity, match[1].upper()), 1 if match[2] == "1" else 2)

    @property
    def character_bits(self) -> int:
        """Bits of one character on the wire: start, eight, parity, stop."""
        return 1 + 8 + (self.parity != "N") + self.stop_bits

    def __str__(self) -> str:
        return f"8{self.parity}{self.stop_bits}"


@dataclass(frozen=True, slots=True)
class LineTiming:
    """The times that follow from a line's speed and framing."""

    baud: int
    framing: Framing
    character_s: float = field(init=False, repr=False, compare=False)  # of one character on the wire
    silence_s: float = field(init=False, repr=False, compare=False)
    """The shortest silence between frames, 3.5 characters as the starters count them."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "character_s", self.framing.character_bits / self.baud)
        bits = max(self.framing.character_bits, _COUNTED_BITS)
        silence_s = 3.5 * max(bits / self.baud, _COUNTED_BITS / _FASTEST_COUNTED_BAUD)
        object.__setattr__(self, "silence_s", silence_s)

    def wire_s(self, byte_count: int) -> float:
        """Return the time that so many bytes without gaps take."""
        return byte_count * self.character_s
