"""Rows by their codes: how they are asked for, what they may be set to, which requests do it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal, InvalidOperation
from typing import TypeVar

from gateway.contract import CommandError, ResultCode
from gateway.families.profile.rows import OFF, RESERVED, Access, Confidence, Parameter, Table, Type
from gateway.families.profile.schema import Profile, Variant
from gateway.families.profile.word_types import SPELT, from_text, of_percent, to_number_words, to_percent
from gateway.modbus import (
    ReadCoils,
    ReadDiscreteInputs,
    ReadHoldingRegisters,
    ReadInputRegisters,
    Request,
    WriteCoil,
    WriteRegister,
    WriteRegisters,
)

_Item = TypeVar("_Item")
RowWords = tuple[Parameter, tuple[int, ...]]  # a row, and what it is to hold

_UNNAMED = "not named in this manual"
_RAW_CODE = re.compile(r"P([0-9]{1,5})")
_REGISTER_CODE = re.compile(r"(HR|IR|COIL|DI)([0-9]{1,5})")
_PREFIXES = {Table.HOLDING: "HR", Table.INPUT: "IR", Table.COIL: "COIL", Table.DISCRETE: "DI"}
READS: dict[Table, type[ReadCoils | ReadDiscreteInputs | ReadHoldingRegisters | ReadInputRegisters]] = {
    Table.HOLDING: ReadHoldingRegisters,
    Table.INPUT: ReadInputRegisters,
    Table.COIL: ReadCoils,
    Table.DISCRETE: ReadDiscreteInputs,
}
NOT_SETTABLE: dict[str, Callable[[Profile, Parameter], bool]] = {  # why none sets a row: the first that holds
    "command": lambda _, row: row.access is Access.COMMAND,
    "no_row": lambda _, row: row.name == _UNNAMED and bool(_REGISTER_CODE.fullmatch(row.code)),
    "not_serial": lambda _, row: row.name == _UNNAMED or row.confidence is Confidence.EXTRA,
    "read_only": lambda _, row: row.access is not Access.RW,
    "password": lambda profile, row: row.code in profile.protected.password,
    "illegible": lambda _, row: not row.is_sure,
    "byte_order": lambda _, row: row.type is Type.STRING,
    "other_model": lambda _, row: bool(row.ranges),
    "no_range": lambda *_: True,
}
_LAST_ADDRESS = 0xFFFF
_LARGEST = Decimal(10) ** 12  # no row carries more; keeps the arithmetic small whatever is asked for


def find(profile: Profile, code: str) -> Parameter:
    """Return the row with this code, in any case; CommandError("unknown_parameter") when there is none.

    Where there is a `raw_range` every other P0-P999 is a row too, read as a raw word: the serial manuals name
    only some of them (ssw07 5.3.2). HR, IR, COIL or DI and an address name any register, coil or discrete
    input; those without a row are read raw, such as the SoftPLC's markers (ssw900 7.1, 7.2.2).
    """
    wanted = spelt(profile, code)
    number = _RAW_CODE.fullmatch(wanted)
    row = profile.parameters.get(wanted)
    if row is None and number is not None:
        row = raw_row(profile, int(number[1]))
    register = _REGISTER_CODE.fullmatch(wanted)
    if row is None and register is not None:
        row = _register(profile, register[1], int(register[2]))
    if row is None:
        raise CommandError(ResultCode.UNKNOWN_PARAMETER, "code", parameter=code.strip()[:40])
    return row


def spelt(profile: Profile, code: str) -> str:
    """Return a code as the manual spells it: P30 is P030 where parameters have three digits."""
    wanted = code.strip().upper()
    number = _RAW_CODE.fullmatch(wanted)
    return wanted if number is None or profile.raw_range is None else f"P{int(number[1]):03d}"


def is_named(name: str) -> bool:
    """Return whether a row's name says what it is: of many the manuals print only the number."""
    return name not in ("", _UNNAMED)


def raw_row(profile: Profile, address: int) -> Parameter | None:
    """Return the row of a parameter that the manual does not describe; None where there can be none."""
    if profile.raw_range is None or not profile.raw_range[0] <= address <= profile.raw_range[1]:
        return None
    return _raw(f"P{address:03d}", Table.HOLDING, address)


def unnamed_code(profile: Profile, table: Table, address: int) -> str:
    """Return the code of a register or coil without a row: HR, IR or COIL and its number."""
    return f"{_PREFIXES[table]}{address + _first_number(profile, table)}"


def _first_number(profile: Profile, table: Table) -> int:
    return profile.first_coil if table is Table.COIL else 0


def _register(profile: Profile, prefix: str, number: int) -> Parameter | None:
    """Return the row of a register or coil, a raw one where none begins; None where there can be none."""
    table = next(each for each, its in _PREFIXES.items() if its == prefix)
    address = number - _first_number(profile, table)
    function = READS[table].function
    if function not in profile.limits.functions:
        raise CommandError(
            ResultCode.UNKNOWN_PARAMETER,
            "function",
            parameter=f"{prefix}{number}",
            function=function,
            title=profile.title,
        )
    if not 0 <= address <= _LAST_ADDRESS:
        return None
    rows = profile.rows_at.get((table, address))
    return rows[0] if rows else _raw(f"{prefix}{number}", table, address)


def _raw(code: str, table: Table, address: int) -> Parameter:
    return Parameter(
        code=code,
        name=_UNNAMED,
        table=table,
        address=address,
        type=Type.BIT if table.is_bits else Type.U16,
        decimals=None,
        access=Access.RO,
        confidence=Confidence.INFERRED,
    )


def runs_of(items: Iterable[_Item], may_join: Callable[[list[_Item], _Item], bool]) -> list[list[_Item]]:
    """Return the items in runs: each joins the one before it where it may."""
    runs: list[list[_Item]] = []
    for item in items:
        if runs and may_join(runs[-1], item):
            runs[-1].append(item)
        else:
            runs.append([item])
    return runs


def read_run(table: Table, address: int, count: int) -> Request:
    """Return the request that reads a run of neighbours in a table."""
    return READS[table](address, count)


def read_request(profile: Profile, parameter: Parameter) -> Request:
    """Return the request that reads this row alone; CommandError("not_readable") where it cannot be."""
    if parameter.access is Access.NONE:
        raise CommandError(
            ResultCode.NOT_READABLE,
            "parameter",
            title=profile.title,
            parameter=parameter.code,
            note=parameter.note,
        )
    return read_run(parameter.table, parameter.address, parameter.words)


def write_request(profile: Profile, parameter: Parameter, words: tuple[int, ...]) -> Request:
    """Return the request that writes this row, also a command row; CommandError("not_writable") for others.

    The words are those of `to_words`, or a command's own: nothing is checked here but the access.
    """
    if parameter.access not in (Access.RW, Access.COMMAND):
        raise CommandError(
            ResultCode.NOT_WRITABLE, "read_only", title=profile.title, parameter=parameter.code
        )
    if parameter.table is Table.COIL:
        return WriteCoil(parameter.address, bool(words[0]))
    if len(words) == 1:
        return WriteRegister(parameter.address, words[0])
    return WriteRegisters(parameter.address, words)


def writes_for(profile: Profile, changes: Sequence[RowWords]) -> list[tuple[Request, list[RowWords]]]:
    """Return one write for each run of neighbouring registers, in order of address, with what it sets."""

    def follows(run: list[RowWords], change: RowWords) -> bool:
        first, last, row = run[0][0], run[-1][0], change[0]
        count = row.address + row.words - first.address
        return last.address + last.words == row.address and count <= profile.limits.write_registers

    return [
        (
            write_request(profile, *run[0])
            if len(run) == 1
            else WriteRegisters(run[0][0].address, tuple(word for _, words in run for word in words)),
            run,
        )
        for run in runs_of(changes, follows)
    ]


def is_read_alone(profile: Profile, row: Parameter) -> bool:
    """Return whether a longer read could show 0 where the starter has no such row (ssw900 7.3)."""
    is_doubtful = not row.is_sure and profile.limits.max_gap > 0
    return is_doubtful or row.code.startswith(profile.rows.optional)


def is_volatile(profile: Profile, row: Parameter) -> bool:
    """Return whether a write of this row does not go to non-volatile memory: what commands and outputs."""
    return row.code.startswith(profile.rows.volatile)


def settable_words(profile: Profile, variant: Variant, row: Parameter, value: object) -> tuple[int, ...]:
    """Return the words that set a row to a value; CommandError when no `set` may do so."""
    if row.code in profile.protected.connection:
        raise CommandError(ResultCode.WOULD_CUT_CONNECTION, parameter=row.code)
    if row.code in profile.protected.actions:
        raise CommandError(ResultCode.NOT_WRITABLE, "action", parameter=row.code)
    if row.access is Access.COMMAND:
        raise CommandError(ResultCode.NOT_WRITABLE, "verb", parameter=row.code)
    return to_words(profile, row, value, variant=variant)


def raw_limits(parameter: Parameter, variant: Variant | None = None) -> tuple[int, int] | None:
    """Return the smallest and largest raw number the row takes; None when it cannot be set.

    With the model known its own limits count (SST register table); unknown, the widest of all models.
    """
    if not parameter.is_writable or parameter.raw_min is None or parameter.raw_max is None:
        return None
    model = (variant.model or "").casefold() if variant is not None else ""
    fitting = [one for one in parameter.ranges if _may_be(one.model.casefold(), model)]
    if not fitting:
        return parameter.raw_min, parameter.raw_max
    lows = [one.raw_min for one in fitting if one.raw_min is not None]
    highs = [one.raw_max for one in fitting if one.raw_max is not None]
    return (min(lows), max(highs)) if lows and highs else None


def factory_settings(profile: Profile) -> dict[str, tuple[int, ...]]:
    """Return the words of each row whose factory setting is printed, by code."""
    return {
        row.code: to_number_words(row, row.factory)
        for row in profile.parameters.values()
        if row.factory is not None
    }


def to_words(
    profile: Profile, parameter: Parameter, value: object, *, variant: Variant | None = None
) -> tuple[int, ...]:
    """Return the words that set a row to a value in its unit, or to an enum's number or label.

    CommandError: "not_writable", "bad_value" (not of its kind), "out_of_range".
    """
    if parameter.is_writable and parameter.is_settable_text:
        return _text_words(parameter, value)
    limits = raw_limits(parameter, variant)
    if limits is None:
        raise _not_settable(profile, parameter)
    members = profile.enums.get(parameter.enum, {})
    raw = _member(parameter, members, profile.english_enums.get(parameter.enum, {}), value)
    if raw is None:
        raw = _raw_number(parameter, value, members)
    if not limits[0] <= raw <= limits[1] or (members and members.get(raw, RESERVED) == RESERVED):
        accepted = _accepted(parameter, limits, members)
        raise CommandError(ResultCode.OUT_OF_RANGE, "parameter", parameter=parameter.code, accepted=accepted)
    return to_number_words(parameter, raw)


def _text_words(parameter: Parameter, value: object) -> tuple[int, ...]:
    words = None
    if isinstance(value, str):
        words = from_text(
            parameter.type, value.strip(), words=parameter.words, longest=parameter.longest or 0
        )
    if words is None:
        code, form = parameter.code, SPELT[parameter.type]
        if not parameter.longest:
            raise CommandError(ResultCode.BAD_VALUE, "spelt", parameter=code, form=form)
        raise CommandError(
            ResultCode.BAD_VALUE, "longest", parameter=code, form=form, longest=parameter.longest
        )
    return words


def _may_be(one: str, model: str) -> bool:
    """Return whether a starter of this model, perhaps named only in part, can be of the table's model."""
    return model.startswith(one) or one.startswith(model)


def _not_settable(profile: Profile, parameter: Parameter) -> CommandError:
    """Return why no value sets a row."""
    title, code, note = profile.title, parameter.code, parameter.note
    if parameter.access is Access.NONE:
        return CommandError(ResultCode.NOT_WRITABLE, "access", title=title, parameter=code, note=note)
    case = next(case for case, holds in NOT_SETTABLE.items() if holds(profile, parameter))
    return CommandError(ResultCode.NOT_WRITABLE, case, title=title, parameter=code)


def _member(
    parameter: Parameter, members: dict[int, str], english: dict[int, str], value: object
) -> int | None:
    if not isinstance(value, str):
        return None
    wanted = value.strip().casefold()
    if wanted == OFF and parameter.off is not None:
        return parameter.off
    named = (*members.items(), *english.items())
    numbers = list(dict.fromkeys(number for number, label in named if label.casefold() == wanted))
    if len(numbers) > 1:
        raise CommandError(ResultCode.BAD_VALUE, "ambiguous", parameter=parameter.code, label=value.strip())
    return numbers[0] if numbers else None


def _raw_number(parameter: Parameter, value: object, members: dict[int, str]) -> int:
    decimals = parameter.decimals or 0
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise CommandError(ResultCode.BAD_VALUE, "number", parameter=parameter.code)
    try:
        number = Decimal(str(value).strip())
    except InvalidOperation:
        raise _no_number(parameter, members) from None
    if not number.is_finite() or abs(number) >= _LARGEST:
        raise CommandError(ResultCode.BAD_VALUE, "number", parameter=parameter.code)
    if parameter.full_scale:
        return of_percent(number, parameter.full_scale)
    scaled = number.scaleb(decimals)
    if scaled != scaled.to_integral_value():
        raise CommandError(ResultCode.BAD_VALUE, "decimals", parameter=parameter.code, decimals=decimals)
    return int(scaled)


def _no_number(parameter: Parameter, members: dict[int, str]) -> CommandError:
    if not members:
        return CommandError(ResultCode.BAD_VALUE, "number", parameter=parameter.code)
    options = _listed(members)
    return CommandError(ResultCode.BAD_VALUE, "member", parameter=parameter.code, options=options)


def _accepted(parameter: Parameter, limits: tuple[int, int], members: dict[int, str]) -> str:
    within = {number: label for number, label in members.items() if limits[0] <= number <= limits[1]}
    if within:
        return f"one of {_listed(within)}"
    if parameter.full_scale:
        low, high = (f"{to_percent(raw, parameter.full_scale):g}" for raw in limits)
        return f"{low}..{high} %"
    decimals = parameter.decimals or 0
    low, high = (f"{raw / 10**decimals:.{decimals}f}" for raw in limits)
    return f"{low}..{high} {parameter.unit}".rstrip()


def _listed(members: dict[int, str]) -> str:
    return ", ".join(f"{number} ({label})" for number, label in members.items() if label != RESERVED)
