"""Reading and setting rows, one or several; what a starter holds already is not written again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from gateway.families.command.arguments import asked_codes, asked_values
from gateway.families.command.control_word import Seen
from gateway.families.command.interlock import points_needed
from gateway.families.command.sst_configuration import configuration, prepare_configuration
from gateway.families.command.writable import holds, is_kept, read_back, read_of, settable_words
from gateway.families.profile.parameters import find, write_request
from gateway.families.profile.procedure import Preparation, Procedure, Read, WriteStep
from gateway.families.profile.refusals import refused
from gateway.families.profile.schema import Parameter, Profile, Variant
from gateway.families.profile.word_types import in_order_of
from gateway.families.reading.bulk import reads_for, rows_of_points
from gateway.modbus.writes import WriteRegisters

Wanted = list[tuple[Parameter, tuple[int, ...]]]


def prepare_read(profile: Profile, args: Mapping[str, Any]) -> Preparation:
    """Return the reads of the rows asked for: the sure ones together, any other one alone.

    Where one unknown register refuses a read, it must not take known ones with it.
    """
    codes, is_single = asked_codes(args)
    if is_single:
        return Preparation("read", reads=(read_of(profile, codes[0]),), requires=())
    alone = {read.codes[0]: read for read in (read_of(profile, code) for code in codes)}
    sure = [code for code in alone if find(profile, code).is_sure]
    others = (read for code, read in alone.items() if code not in sure)
    return Preparation("read", reads=(*reads_for(profile, sure), *others), requires=())


def build_read(profile: Profile, args: Mapping[str, Any]) -> Procedure:
    """Return the procedure of a read, which writes nothing."""
    codes, is_single = asked_codes(args)
    found = tuple(dict.fromkeys(find(profile, code).code for code in codes))
    prepare_read(profile, args)  # refuses what cannot be read
    return Procedure("read", (), subject=found[0]) if is_single else Procedure("read", (), subjects=found)


def rows_set(profile: Profile, args: Mapping[str, Any]) -> tuple[Parameter, ...]:
    """Return the rows that a `set` names."""
    values, _ = asked_values(args)
    return tuple(find(profile, code) for code in values)


def prepare_set(profile: Profile, variant: Variant, args: Mapping[str, Any]) -> Preparation:
    """Return what to read before rows are set: they, what their values hang on, the motor's state."""
    wanted, is_single = _wanted(profile, variant, args)
    codes = [row.code for row, _ in wanted]
    if _is_configuration(wanted):
        return prepare_configuration(profile, "set", codes=codes)
    requires = ("is_stopped",) if any(row.is_stopped_only for row, _ in wanted) else ()
    others = [*(other for code in codes for other in _TIMEOUT.get(code, ()))]
    others += rows_of_points(profile, points_needed(profile, requires))
    if is_single:
        reads: tuple[Read, ...] = (read_of(profile, codes[0]), *reads_for(profile, others))
    else:
        reads = reads_for(profile, (*codes, *others))
    return Preparation("set", reads=reads, requires=requires)


def build_set(profile: Profile, variant: Variant, args: Mapping[str, Any], *, seen: Seen) -> Procedure:
    """Return the writes that are needed and their read-back; for the SST its whole procedure."""
    wanted, is_single = _wanted(profile, variant, args)
    wanted = [(row, _in_order(row, words, seen)) for row, words in wanted]
    _check_timeout(wanted, seen)
    codes = tuple(row.code for row, _ in wanted)
    subject, subjects = (codes[0], ()) if is_single else ("", codes)
    changes = sorted(
        ((row, words) for row, words in wanted if not holds(row, words, seen)),
        key=lambda pair: pair[0].address,
    )
    if not changes:
        return Procedure("set", (), is_unchanged=True, subject=subject, subjects=subjects)
    if _is_configuration(wanted):
        rows = {row.code: words for row, words in wanted}
        return configuration(profile, "set", wanted=rows, seen=seen, subject=subject, subjects=subjects)
    return Procedure(
        "set",
        tuple(_steps(profile, changes)),
        verify=read_back(profile, wanted),
        subject=subject,
        subjects=subjects,
        wears=sum(is_kept(row) for row, _ in changes),
    )


# The mode of the timeout and its time: the manual does not say what an active timeout of 0.0 s does
# (ssw900 C8.2.5), so neither row may bring it about.
_MODE, _TIME = "C8.2.5.1", "C8.2.5.3"
_TIMEOUT = {_MODE: (_TIME,), _TIME: (_MODE,)}


def _wanted(profile: Profile, variant: Variant, args: Mapping[str, Any]) -> tuple[Wanted, bool]:
    """Return the rows with the words that set them, and whether it is a single one asked for as such."""
    values, is_single = asked_values(args)
    wanted: Wanted = []
    for code, value in values.items():
        row = find(profile, code)
        wanted.append((row, settable_words(profile, variant, row, value)))
    _check_once(wanted)
    return wanted, is_single


def _in_order(row: Parameter, words: tuple[int, ...], seen: Seen) -> tuple[int, ...]:
    """Return a text's words in the byte order that the row was seen in; it is not stated."""
    if not row.is_settable_text or row.code not in seen:
        return words
    return in_order_of(row.type, words, seen[row.code])


def _check_once(wanted: Wanted) -> None:
    for (one, _), (other, _) in pairwise(sorted(wanted, key=lambda pair: pair[0].address)):
        if one.address == other.address:
            raise refused("bad_arguments", f"{one.code} and {other.code} are the same register")


def _is_configuration(wanted: Wanted) -> bool:
    return any(row.is_configuration for row, _ in wanted)  # the SST has no other rows to be set


def _check_timeout(wanted: Wanted, seen: Seen) -> None:
    words = {row.code: words for row, words in wanted}
    time = words.get(_TIME, seen.get(_TIME, ()))
    if any(words.get(_MODE, ())) and not any(time):
        raise refused("timeout_unset", f"set {_TIME} above 0 first")
    if _TIME in words and not any(words[_TIME]) and any(seen.get(_MODE, (1,))):
        raise refused("timeout_unset", f"set {_MODE} to 0 first")


def _steps(profile: Profile, changes: Wanted) -> list[WriteStep]:
    """Return one write for each run of neighbouring registers, all of which change.

    The time of the timeout must stand before its mode makes it act.
    """
    runs: list[Wanted] = []
    for row, words in changes:
        if runs and _follows(profile, runs[-1], row):
            runs[-1].append((row, words))
        else:
            runs.append([(row, words)])
    steps = []
    for run in runs:
        must_stand = len(runs) > 1 and any(row.code == _TIME for row, _ in run)
        steps.append(_step(profile, run, must_stand=must_stand))
    return steps


def _follows(profile: Profile, run: Wanted, row: Parameter) -> bool:
    first, last = run[0][0], run[-1][0]
    count = row.address + row.words - first.address
    return last.address + last.words == row.address and count <= profile.limits.write_registers


def _step(
    profile: Profile, run: Sequence[tuple[Parameter, tuple[int, ...]]], *, must_stand: bool
) -> WriteStep:
    row, words = run[0]
    if len(run) == 1:
        request = write_request(profile, row, words)
    else:
        request = WriteRegisters(row.address, tuple(word for _, words in run for word in words))
    return WriteStep(request, then=read_back(profile, run) if must_stand else None)
