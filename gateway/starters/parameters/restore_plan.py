"""What a restore would change: only settings that differ and that may be written, in a safe order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from functools import partial

from gateway.contract import CommandError, ResultCode
from gateway.families import (
    TYPE_LIMITS,
    Parameter,
    Profile,
    Variant,
    decode,
    from_words,
    parameters,
    reading,
)
from gateway.starters.parameters.model import Difference, ParameterEntry, ParameterSet, entries_of


@dataclass(frozen=True, slots=True)
class PlannedWrite(Difference):
    """One parameter that a restore writes."""

    value: decode.Value  # what a `set` is given
    words: tuple[int, ...]  # as the starter will hold them
    is_configuration: bool  # SST: all of them are set by one command


@dataclass(frozen=True, slots=True)
class RestorePlan:
    """What a restore writes, and by code why it leaves other differences alone."""

    changes: tuple[PlannedWrite, ...]
    left: Mapping[str, str]


def plan_restore(
    profile: Profile,
    variant: Variant,
    *,
    wanted: ParameterSet,
    seen: Mapping[str, tuple[int, ...]],
    with_sources: bool = False,
) -> RestorePlan:
    """Return what makes a starter, of which these rows were just read, hold the wanted settings.

    `with_sources`: also those that say who commands the motor. Where a run command stands at the new source,
    an input for instance, such a change starts the motor.
    """
    changes: list[PlannedWrite] = []
    left: dict[str, str] = {}
    for code in restore_codes(profile, wanted):
        if code not in seen:
            left[code] = "the starter does not give it"
            continue
        try:
            change = _change(profile, variant, profile.parameters[code], wanted.parameters[code], seen=seen)
        except CommandError as error:
            left[code] = error.text
            continue
        if change is not None and change.code in profile.protected.command_sources and not with_sources:
            left[code] = f"{change.sides} would change who commands the motor"
        elif change is not None:
            changes.append(change)
    return RestorePlan(tuple(sorted(changes, key=partial(_place_of, profile))), left)


def restore_codes(profile: Profile, wanted: ParameterSet) -> tuple[str, ...]:
    """Return the settings of a set that the family has: they must be read before a restore is planned."""
    rows = (profile.parameters.get(code) for code in wanted.parameters)
    return tuple(row.code for row in rows if row is not None and reading.is_setting(profile, row))


def groups_of(changes: tuple[PlannedWrite, ...]) -> Iterator[tuple[PlannedWrite, ...]]:
    """Yield what one command writes: each change alone, all configuration registers of an SST together."""
    together = tuple(change for change in changes if change.is_configuration)
    if together:
        yield together
    yield from ((change,) for change in changes if not change.is_configuration)


def _change(
    profile: Profile,
    variant: Variant,
    row: Parameter,
    entry: ParameterEntry,
    *,
    seen: Mapping[str, tuple[int, ...]],
) -> PlannedWrite | None:
    """Return the change of one row, None when the starter holds the value; CommandError when it cannot be."""
    now = entries_of(profile, variant, {row.code: seen[row.code]})[row.code]
    if entry.raw == now.raw and entry.value in (None, now.value):
        return None  # also of a row that can never be set
    if entry.raw is not None and len(entry.raw) != row.words:
        raise CommandError(ResultCode.BAD_VALUE, "words", words=row.words, given=len(entry.raw))
    value = _value(row, entry)
    words = parameters.settable_words(profile, variant, row, value)
    if entry.value is not None and parameters.settable_words(profile, variant, row, entry.value) != words:
        raise CommandError(ResultCode.BAD_VALUE, "file")
    if reading.holds(row, words, seen):
        return None
    after = entries_of(profile, variant, {row.code: words})[row.code]
    return PlannedWrite(row.code, row.name, now, after, value, words, row.is_configuration)


def _value(row: Parameter, entry: ParameterEntry) -> decode.Value:
    """Return what sets the row to a file's entry: its raw number in the row's unit, else the value itself."""
    if entry.raw is None or row.type not in TYPE_LIMITS:
        return entry.value
    return str(Decimal(from_words(row, entry.raw)).scaleb(-(row.decimals or 0)))


def _place_of(profile: Profile, change: PlannedWrite) -> int:
    """Return the place of a change in the order of writing: a timeout is never active at 0.0 s on the way.

    The time of the timeout comes before its mode, or behind it when the time becomes 0. The command sources
    come last: everything else is as it shall be by then.
    """
    timeout = profile.protected.timeout
    if change.code in profile.protected.command_sources:
        return 3
    if timeout is None or change.code != timeout.time:
        return 1
    return 0 if any(change.words) else 2
