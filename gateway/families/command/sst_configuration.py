"""The SST's initialisation sequence, the only way in which its configuration registers may be written.

A register written outside the configuration mode stops the motor, and so does entering the mode (coil table).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gateway.families.command.control_word import Seen
from gateway.families.command.interlock import points_needed
from gateway.families.command.writable import holds, read_back, read_of, settable_words
from gateway.families.profile.parameters import find, write_request
from gateway.families.profile.procedure import Expect, Preparation, Procedure, WriteStep
from gateway.families.profile.refusals import refused
from gateway.families.profile.schema import Parameter, Profile, Variant
from gateway.families.reading.bulk import reads_for, rows_of_points
from gateway.modbus.writes import WriteCoil

RULES = ("serial_controls",)  # and standstill: families/command/run_command.py
MODE_WITHIN_S = 2.0  # until coil 2 shows the configuration mode
FLASH_WITHIN_S = 5.0  # until coil 5 shows that the configuration is in flash (NOTES)


def prepare_configure(profile: Profile, variant: Variant, args: Mapping[str, Any]) -> Preparation:
    """Return what to read before the starter is initialised; `args` are new values by register, or none."""
    codes = tuple(_wanted(profile, variant, args))
    return prepare_configuration(profile, "configure", codes=codes)


def build_configure(profile: Profile, variant: Variant, args: Mapping[str, Any], *, seen: Seen) -> Procedure:
    """Return the whole sequence, also when no register differs from what was seen: it releases the start."""
    wanted = _wanted(profile, variant, args)
    return configuration(profile, "configure", wanted=wanted, seen=seen)


def prepare_configuration(profile: Profile, verb: str, *, codes: Sequence[str]) -> Preparation:
    """Return what to read, and what must hold, before these registers are written."""
    needed = rows_of_points(profile, points_needed(profile, RULES))
    reads = reads_for(profile, (*needed, _COMPLETE, *codes))
    return Preparation(verb, reads=reads, requires=RULES)


def configuration(
    profile: Profile,
    verb: str,
    *,
    wanted: Mapping[str, tuple[int, ...]],
    seen: Seen,
    subject: str = "",
    subjects: tuple[str, ...] = (),
) -> Procedure:
    """Return the sequence that writes those registers that differ from what was seen (each goes to flash).

    Registers are written one by one: what the text says of FC16 contradicts the Modbus specification. Leaving
    the mode counts as one write of the flash, whether something differs or not.
    """
    pairs = [(profile.parameters[code], words) for code, words in wanted.items()]
    leave = WriteCoil(profile.parameters[_MODE].address, is_on=False)
    steps = (
        WriteStep(
            WriteCoil(leave.address, is_on=True), then=_coil_is_set(profile, _MODE, within_s=MODE_WITHIN_S)
        ),
        *(
            WriteStep(write_request(profile, row, words))
            for row, words in pairs
            if not holds(row, words, seen)
        ),
        WriteStep(leave, then=_coil_is_set(profile, _COMPLETE, within_s=FLASH_WITHIN_S)),
    )
    complete = _coil_is_set(profile, _COMPLETE, within_s=FLASH_WITHIN_S)
    return Procedure(
        verb,
        steps,
        verify=read_back(profile, pairs) if pairs else complete,
        abandon=(leave,),
        subject=subject,
        subjects=subjects,
        wears=1,
    )


_MODE, _COMPLETE = "COIL2", "COIL5"


def _wanted(profile: Profile, variant: Variant, args: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
    wanted: dict[str, tuple[int, ...]] = {}
    for code, value in args.items():
        row = find(profile, code)
        if row.code in wanted:
            raise refused("bad_arguments", f"{row.code} stands twice")
        wanted[row.code] = _words(profile, variant, row, value)
    return wanted


def _words(profile: Profile, variant: Variant, row: Parameter, value: object) -> tuple[int, ...]:
    if not row.is_configuration:
        raise refused("bad_arguments", f"{row.code} is no configuration register")
    return settable_words(profile, variant, row, value)


def _coil_is_set(profile: Profile, code: str, *, within_s: float) -> Expect:
    return Expect((read_of(profile, code),), name=code, is_one_of=((1,),), within_s=within_s)
