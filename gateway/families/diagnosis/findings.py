"""What a starter's own settings mean for whoever wants to run it from afar: findings, and its watchdogs."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass

from gateway.families.profile.decode import decode_row
from gateway.families.profile.schema import Profile, Variant
from gateway.families.profile.word_types import from_words


class Weight(enum.StrEnum):
    """How much a finding matters: a note is good to know, the others bite."""

    NOTE = "note"
    WARNING = "warning"
    ERROR = "error"


class Topic(enum.StrEnum):
    """What a finding is about."""

    START = "start"  # an error here: a start would be refused
    LOCAL = "local"
    WATCHDOG = "watchdog"
    OUTPUT = "output"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that the settings bring about, in a sentence."""

    topic: Topic
    weight: Weight
    text: str


@dataclass(frozen=True, slots=True)
class Watchdog:
    """One supervision of the communication that is switched on in the starter."""

    code: str  # of the row that holds its time
    after_s: float  # without a valid request
    does: str  # "it ..." in words
    is_felt: bool  # whether it does anything to the motor


class Settings:
    """Some rows of one starter, as numbers and in words."""

    def __init__(self, profile: Profile, variant: Variant, rows: Mapping[str, tuple[int, ...]]) -> None:
        self.profile = profile
        self.variant = variant
        self._rows = rows

    def number(self, code: str) -> int | None:
        """Return the raw number of a row; None when it was not read or the family has none."""
        words = self._rows.get(code)
        return None if words is None else from_words(self.profile.parameters[code], words)

    def shown(self, code: str) -> str:
        """Return a row that was read for a sentence, e.g. "P230 = 1 (DI)"."""
        row = self.profile.parameters[code]
        decoded = decode_row(self.profile, self.variant, row, self._rows[code])
        value = decoded.raw[0] if isinstance(decoded.value, bool) or decoded.value is None else decoded.value
        label = f" ({decoded.label})" if decoded.label else ""
        return f"{code} = {value:g}{label}" if isinstance(value, float) else f"{code} = {value}{label}"
