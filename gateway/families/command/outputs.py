"""Relays and analog outputs that the serial line drives (ssw06-es 4.2.6-4.2.8, ssw07 4.2.3, SSW900 S5.3).

A relay is one bit of a word without mask. Where the family has FC22 the starter itself changes that one bit;
elsewhere the word is built from the one just read. An output whose function is not set to the serial line
ignores what is written to it, without an error.
"""

from __future__ import annotations

from collections.abc import Mapping
from decimal import Decimal
from typing import Any

from gateway.contract import CommandError, Note, ResultCode
from gateway.families.command.interlock import check_set_to_serial
from gateway.families.profile.arguments import check_names, choice, to_switch
from gateway.families.profile.procedure import Expect, Preparation, Procedure, Seen, WriteStep
from gateway.families.profile.schema import Output, Profile
from gateway.families.profile.word_types import of_percent
from gateway.families.reading import SET_WITHIN_S, read_of, reads_for
from gateway.modbus import Function, MaskWriteRegister, Request, WriteRegister


def prepare_output(profile: Profile, args: Mapping[str, Any]) -> Preparation:
    """Return the reads of the word that drives the output, and of the row that says who drives it."""
    name, output = _output(profile, args)
    _number(name, output, args["value"])
    return Preparation(reads=reads_for(profile, (output.word, output.function)), requires=())


def build_output(profile: Profile, args: Mapping[str, Any], *, seen: Seen) -> Procedure:
    """Return the one write that drives the output, its read-back, and what that does not prove."""
    name, output = _output(profile, args)
    wanted = _number(name, output, args["value"])
    if output.option is not None:
        check_set_to_serial(profile, {output.function: (output.option,)}, seen)
    notes = _notes(profile, name, output, seen)
    mask = 0xFFFF if output.bit is None else 1 << output.bit
    last = seen.get(output.word)
    if last is not None and last[0] & mask == wanted:
        return Procedure((), is_unchanged=True, subject=output.word, notes=notes)
    request = _request(profile, output, wanted, last=last)
    reads = (read_of(profile, output.word),)
    shown = Expect(reads, output.word, is_one_of=((wanted,),), within_s=SET_WITHIN_S, mask=mask)
    return Procedure((WriteStep(request),), verify=shown, subject=output.word, notes=notes)


def _output(profile: Profile, args: Mapping[str, Any]) -> tuple[str, Output]:
    check_names(args, ("output", "value"))
    name = choice(args, "output", tuple(profile.outputs))
    return name, profile.outputs[name]


def _number(name: str, output: Output, value: object) -> int:
    """Return the bits that the word must show; half a step of an analog output is rounded down (5.4.6)."""
    if output.bit is not None:
        is_on = to_switch(value)
        if is_on is None:
            raise CommandError(ResultCode.BAD_VALUE, "relay", output=name)
        return int(is_on) << output.bit
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise CommandError(ResultCode.BAD_VALUE, "analog", output=name)
    if not 0 <= value <= 100:
        raise CommandError(ResultCode.OUT_OF_RANGE, "output", output=name)
    return of_percent(Decimal(str(value)), output.full_scale or 0)


def _notes(profile: Profile, name: str, output: Output, seen: Seen) -> tuple[Note, ...]:
    """Return what a read-back does not prove: that the output follows the word."""
    if output.option is not None:
        return ()
    row = profile.parameters[output.function]
    if row.code not in seen:
        note = Note("output_function", output=name, word=output.word, row=row.code, name=row.name)
    else:
        reading = seen[row.code][0]
        note = Note(
            "output_function_read",
            output=name,
            word=output.word,
            row=row.code,
            name=row.name,
            reading=reading,
        )
    return (note,)


def _request(profile: Profile, output: Output, wanted: int, *, last: tuple[int, ...] | None) -> Request:
    row = profile.parameters[output.word]
    if output.bit is None:
        return WriteRegister(row.address, wanted)
    mask = 1 << output.bit
    if Function.MASK_WRITE_REGISTER in profile.limits.functions:
        return MaskWriteRegister(row.address, and_mask=0xFFFF & ~mask, or_mask=wanted)
    if last is None:
        raise CommandError(ResultCode.WORD_UNKNOWN, "output", row=row.code)
    others = last[0] & (row.raw_max or 0) & ~mask
    return WriteRegister(row.address, others | wanted)
