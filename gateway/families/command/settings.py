"""Reading and setting rows, one or several; what a starter holds already is not written again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

from gateway.contract import CommandError, Note, ResultCode
from gateway.families.command.interlock import points_needed
from gateway.families.devices import device_of
from gateway.families.profile.arguments import asked_codes, asked_values
from gateway.families.profile.parameters import RowWords, find, is_volatile, settable_words, writes_for
from gateway.families.profile.procedure import Preparation, Procedure, Seen, WriteStep
from gateway.families.profile.rows import Parameter
from gateway.families.profile.schema import Profile, Variant
from gateway.families.profile.word_types import in_order_of
from gateway.families.reading import holds, is_setting, read_back, read_of, reads_for, rows_of_points

Wanted = list[RowWords]


def prepare_read(profile: Profile, args: Mapping[str, Any]) -> Preparation:
    """Return the reads of the rows asked for: the sure ones together, any other one alone.

    Where one unknown register refuses a read, it must not take known ones with it.
    """
    codes, is_single = asked_codes(args)
    if is_single:
        return Preparation(reads=(read_of(profile, codes[0]),), requires=())
    alone = {read.codes[0]: read for read in (read_of(profile, code) for code in codes)}
    sure = [code for code in alone if find(profile, code).is_sure]
    others = (read for code, read in alone.items() if code not in sure)
    return Preparation(reads=(*reads_for(profile, sure), *others), requires=())


def build_read(profile: Profile, args: Mapping[str, Any]) -> Procedure:
    """Return the procedure of a read, which writes nothing."""
    codes, is_single = asked_codes(args)
    found = tuple(dict.fromkeys(find(profile, code).code for code in codes))
    prepare_read(profile, args)  # refuses what cannot be read
    return Procedure((), subject=found[0]) if is_single else Procedure((), subjects=found)


def rows_set(profile: Profile, args: Mapping[str, Any]) -> tuple[Parameter, ...]:
    """Return the rows that a `set` names."""
    values, _ = asked_values(args)
    return tuple(find(profile, code) for code in values)


def prepare_set(profile: Profile, variant: Variant, args: Mapping[str, Any]) -> Preparation:
    """Return what to read before rows are set: they, what their values hang on, the motor's state."""
    wanted, _ = _wanted(profile, variant, args)
    codes = [row.code for row, _ in wanted]
    if _is_configuration(wanted):
        return device_of(profile).prepare_configure(profile, variant, asked_values(args)[0])
    requires = ("is_stopped",) if any(row.is_stopped_only for row, _ in wanted) else ()
    needed = rows_of_points(profile, points_needed(profile, requires))
    reads = reads_for(profile, (*codes, *_timeout_rows(profile, codes), *needed))
    return Preparation(reads=reads, requires=requires)


def build_set(profile: Profile, variant: Variant, args: Mapping[str, Any], *, seen: Seen) -> Procedure:
    """Return the writes that are needed and their read-back; for the SST its whole procedure."""
    wanted, is_single = _wanted(profile, variant, args)
    wanted = [(row, _in_order(row, words, seen)) for row, words in wanted]
    _check_timeout(profile, wanted, seen)
    codes = tuple(row.code for row, _ in wanted)
    subject, subjects = (codes[0], ()) if is_single else ("", codes)
    changes = sorted(
        ((row, words) for row, words in wanted if not holds(row, words, seen)),
        key=lambda pair: pair[0].address,
    )
    if not changes:
        return Procedure((), is_unchanged=True, subject=subject, subjects=subjects)
    if _is_configuration(wanted):
        procedure = device_of(profile).build_configure(profile, variant, asked_values(args)[0], seen=seen)
        return replace(procedure, subject=subject, subjects=subjects)
    note = profile.rows.set_note if any(is_setting(profile, row) for row, _ in changes) else ""
    return Procedure(
        tuple(_steps(profile, changes)),
        notes=(Note("family", note=note),) if note else (),
        verify=read_back(profile, wanted),
        subject=subject,
        subjects=subjects,
        wears=sum(not is_volatile(profile, row) for row, _ in changes),
    )


def _timeout_rows(profile: Profile, codes: Sequence[str]) -> tuple[str, ...]:
    """Return the rows of the timeout where one of them is set: neither may make it active at 0."""
    timeout = profile.protected.timeout
    rows = () if timeout is None else (timeout.mode, timeout.time)
    return rows if any(code in rows for code in codes) else ()


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
            raise CommandError(ResultCode.BAD_ARGUMENTS, "same_register", one=one.code, other=other.code)


def _is_configuration(wanted: Wanted) -> bool:
    return any(row.is_configuration for row, _ in wanted)  # the SST has no other rows to be set


def _check_timeout(profile: Profile, wanted: Wanted, seen: Seen) -> None:
    timeout = profile.protected.timeout
    if timeout is None:
        return
    mode, time = timeout.mode, timeout.time
    words = {row.code: words for row, words in wanted}
    if any(words.get(mode, ())) and not any(words.get(time, seen.get(time, ()))):
        raise CommandError(ResultCode.TIMEOUT_UNSET, "time", row=time)
    if time in words and not any(words[time]) and any(seen.get(mode, (1,))):
        raise CommandError(ResultCode.TIMEOUT_UNSET, "mode", row=mode)


def _steps(profile: Profile, changes: Wanted) -> list[WriteStep]:
    """Return one write for each run of neighbours; the time of a timeout stands before its mode."""
    writes = writes_for(profile, changes)
    timeout = profile.protected.timeout
    time = timeout.time if timeout is not None and len(writes) > 1 else ""
    return [
        WriteStep(request, then=read_back(profile, run) if any(row.code == time for row, _ in run) else None)
        for request, run in writes
    ]
