"""The meaning of a starter's own settings for remote control: findings, and its watchdogs."""

from __future__ import annotations

import enum
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from gateway.families.profile.decode import decode_row
from gateway.families.profile.schema import Profile, Variant
from gateway.families.profile.word_types import from_words


class Weight(enum.StrEnum):
    """How much a finding matters: a note is good to know, the others are problems."""

    NOTE = "note"
    WARNING = "warning"
    ERROR = "error"


class Topic(enum.StrEnum):
    """The subject of a finding."""

    START = "start"  # an error here: a start would be refused
    LOCAL = "local"
    WATCHDOG = "watchdog"
    OUTPUT = "output"


@dataclass(frozen=True, slots=True)
class Remark:
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


def start(weight: Weight, text: str) -> Remark:
    """Return a finding about a start."""
    return Remark(Topic.START, weight, text)


def unread(settings: Settings, codes: Iterable[str], topic: Topic) -> Iterator[Remark]:
    """Say which of these rows could not be read."""
    for code in codes:
        if settings.number(code) is None:
            what = f"{code} could not be read, so what it brings about is not known"
            yield Remark(topic, Weight.WARNING, what)


ALWAYS_LOCAL, ALWAYS_REMOTE = 0, 1  # of the row that chooses between local and remote, in all WEG families


def sources(
    settings: Settings, codes: Sequence[str], *, own: int, name: str, own_modes: tuple[int, ...]
) -> Iterator[Remark]:
    """Say who commands the motor, by the rows of: local or remote, the local source, the remote source.

    `own` is the number of this line as a source, `name` its label; with `own_modes` it chooses local or
    remote itself.
    """
    mode, local, remote = (settings.number(code) for code in codes)
    if remote not in (None, own) and (mode != ALWAYS_LOCAL or local != own):
        what = "a start is not executed: in remote mode the commands come from elsewhere"
        fix = f"set {codes[2]} = {own}, {name}"
        acts_in_local = local == own and mode != ALWAYS_REMOTE
        weight = Weight.WARNING if acts_in_local else Weight.ERROR
        yield start(weight, f"{what}: {settings.shown(codes[2])} ({fix})")
    if mode == ALWAYS_LOCAL and local not in (None, own):
        what = "a start needs remote mode, and the starter is never in it"
        fix = f"set {codes[0]} = {ALWAYS_REMOTE} or {own_modes[-1]}, or {codes[1]} = {own}"
        yield start(Weight.ERROR, f"{what}: {settings.shown(codes[0])} ({fix})")
    elif mode not in (None, ALWAYS_LOCAL, ALWAYS_REMOTE, *own_modes) and local != own:
        what = "somebody else chooses local or remote, and in local mode a start is refused"
        yield Remark(Topic.LOCAL, Weight.NOTE, f"{what}: {settings.shown(codes[0])}")
    if local == own and mode != ALWAYS_REMOTE:
        what = "in local mode the commands of this line act as well"
        yield Remark(Topic.LOCAL, Weight.NOTE, f"{what}: {settings.shown(codes[1])}")
    elif local is not None and mode != ALWAYS_REMOTE:
        what = "in local mode neither a start nor a stop of the gateway acts"
        yield Remark(Topic.LOCAL, Weight.NOTE, f"{what}: {settings.shown(codes[1])}")


def is_one_of(numbers: tuple[int, ...], *read: int | None) -> bool:
    """Return whether any of these readings may be one of the numbers: one that is not known may be."""
    return any(number is None or number in numbers for number in read)
