"""Reading and setting one row; what a starter holds already is not written again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.families.arguments import check_names, text
from gateway.families.configuration import configuration, prepare_configuration
from gateway.families.gather import reads_for, rows_of_points
from gateway.families.interlock import points_needed
from gateway.families.parameters import find, write_request
from gateway.families.procedure import Preparation, Procedure, WriteStep
from gateway.families.refusals import refused
from gateway.families.schema import Parameter, Profile, Variant
from gateway.families.settable import holds, read_back, read_of, settable_words
from gateway.families.words import Seen


def prepare_read(profile: Profile, args: Mapping[str, Any]) -> Preparation:
    """Return the one read of a row."""
    check_names(args, ("parameter",))
    return Preparation("read", reads=(read_of(profile, text(args, "parameter")),), requires=())


def build_read(profile: Profile, args: Mapping[str, Any]) -> Procedure:
    """Return the procedure of a read, which writes nothing."""
    (read,) = prepare_read(profile, args).reads
    return Procedure("read", steps=(), subject=read.codes[0])


def prepare_set(profile: Profile, variant: Variant, args: Mapping[str, Any]) -> Preparation:
    """Return what to read before a row is set: itself, the row that its value hangs on, the motor's state."""
    row, _ = _wanted(profile, variant, args)
    if row.is_configuration:
        return prepare_configuration(profile, variant, "set", codes=(row.code,))
    requires = ("is_stopped",) if row.is_stopped_only else ()
    codes = (*_TIMEOUT.get(row.code, ()), *rows_of_points(profile, points_needed(profile, requires)))
    reads = (read_of(profile, row.code), *reads_for(profile, codes))
    return Preparation("set", reads=reads, requires=requires)


def build_set(profile: Profile, variant: Variant, args: Mapping[str, Any], *, seen: Seen) -> Procedure:
    """Return one write and its read-back; for a configuration register of the SST its whole procedure."""
    row, words = _wanted(profile, variant, args)
    _check_timeout(row, words, seen)
    if holds(row, words, seen):
        return Procedure("set", steps=(), is_unchanged=True, subject=row.code)
    if row.is_configuration:
        return configuration(profile, variant, "set", wanted={row.code: words}, seen=seen)
    step = WriteStep(write_request(profile, row, words))
    return Procedure("set", (step,), verify=read_back(profile, [(row, words)]), subject=row.code)


# The mode of the timeout and its time: the manual does not say what an active timeout of 0.0 s does
# (ssw900 C8.2.5), so neither row may bring it about.
_MODE, _TIME = "C8.2.5.1", "C8.2.5.3"
_TIMEOUT = {_MODE: (_TIME,), _TIME: (_MODE,)}


def _wanted(profile: Profile, variant: Variant, args: Mapping[str, Any]) -> tuple[Parameter, tuple[int, ...]]:
    check_names(args, ("parameter", "value"))
    row = find(profile, text(args, "parameter"))
    return row, settable_words(profile, variant, row, args["value"])


def _check_timeout(row: Parameter, words: tuple[int, ...], seen: Seen) -> None:
    if row.code == _MODE and any(words) and not any(seen.get(_TIME, ())):
        raise refused("timeout_unset", f"set {_TIME} above 0 first")
    if row.code == _TIME and not any(words) and any(seen.get(_MODE, (1,))):
        raise refused("timeout_unset", f"set {_MODE} to 0 first")
