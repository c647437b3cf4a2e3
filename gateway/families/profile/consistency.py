"""What must hold between the parts of a profile: every name used exists, every figure fits."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from gateway.families.profile.parameters import READS
from gateway.families.profile.rows import Access, Parameter, Table, Type
from gateway.families.profile.schema import Output, Point, Profile, Write
from gateway.families.profile.word_types import TYPE_LIMITS, TYPE_WORDS

_ENUM_TYPES = (Type.ENUM, Type.LOW_ENUM)
_READ_OVERHEAD = 5  # bytes of a reply frame beside its words: unit, function, byte count, CRC
_WRITE_OVERHEAD = 9  # bytes of an FC16 frame beside its words


def contradictions(profile: Profile) -> list[str]:
    """Return every mistake in how the parts of a profile fit together, one line each."""
    return [
        *(problem for row in profile.parameters.values() for problem in _row(profile, row)),
        *_overlaps(profile),
        *_labels(profile),
        *_names(profile),
        *(problem for name, point in profile.points.items() for problem in _point(profile, name, point)),
        *(problem for verb in profile.commands for problem in _command(profile, verb)),
        *(problem for name, output in profile.outputs.items() for problem in _output(profile, name, output)),
        *_limits(profile),
        *_history(profile),
    ]


def _row(profile: Profile, row: Parameter) -> Iterator[str]:
    if row.code != row.code.upper():
        yield f"{row.code}: codes are written in upper case"
    if row.words != TYPE_WORDS.get(row.type, row.words):
        yield f"{row.code}: {row.type} takes {TYPE_WORDS[row.type]} words, not {row.words}"
    if row.table.is_bits != (row.type is Type.BIT):
        yield f"{row.code}: a coil is a bit, and nothing else is"
    if row.alias_of and not _is_alias(profile, row):
        yield f"{row.code}: {row.alias_of} is not on the same register"
    is_fitting = row.type is Type.BIT or bool(row.enum) == (row.type in _ENUM_TYPES)
    if not is_fitting or (row.enum and row.enum not in profile.enums):
        yield f"{row.code}: enum {row.enum!r} does not exist or does not fit the type"
    if row.type is Type.BITS and row.code not in profile.bits:
        yield f"{row.code}: its bits are not named"
    for low, high in ((row.raw_min, row.raw_max), *((one.raw_min, one.raw_max) for one in row.ranges)):
        yield from _range(row, low, high)


def _is_alias(profile: Profile, row: Parameter) -> bool:
    other = profile.parameters.get(row.alias_of)
    if other is None:
        return False
    return (other.table, other.address, other.type) == (row.table, row.address, row.type)


def _range(row: Parameter, low: int | None, high: int | None) -> Iterator[str]:
    if low is None and high is None:
        return
    lowest, highest = TYPE_LIMITS.get(row.type, (0, -1))
    if low is None or high is None or not lowest <= low <= high <= highest:
        yield f"{row.code}: limits {low}..{high} do not fit {row.type}"


def _overlaps(profile: Profile) -> Iterator[str]:
    rows = sorted(profile.parameters.values(), key=lambda row: (row.table, row.address, row.words))
    for one, other in pairwise(rows):
        are_apart = one.table is not other.table or one.address + one.words <= other.address
        if not are_apart and other.alias_of != one.code:
            yield f"{other.code}: overlaps {one.code}"


def _labels(profile: Profile) -> Iterator[str]:
    used = {row.enum for row in profile.parameters.values()}
    used |= {f"{code}.{bit}" for code, labels in profile.bits.items() for bit in labels}
    yield from (f"enums.csv: no parameter uses {name}" for name in profile.enums if name not in used)
    for code, labels in profile.bits.items():
        row = profile.parameters.get(code)
        if row is None or row.type is not Type.BITS:
            yield f"bits.csv: {code} is no row of bits"
        yield from (f"bits.csv: {code} has no bit {bit}" for bit in labels if not 0 <= bit <= 15)


def _names(profile: Profile) -> Iterator[str]:
    named = {profile.status_word, *profile.command_word} - {""}
    yield from (f"family.toml: {code} is no parameter" for code in sorted(named - set(profile.parameters)))
    protected = profile.protected
    kinds = (protected.command_sources, protected.waking, protected.connection, protected.actions)
    rows_named = [code for kind in (*kinds, protected.password) for code in kind]
    rows_named += [each.code for each in profile.shown_by.values()] + list(profile.shown_by)
    rows_named += [profile.local_control.code] if profile.local_control is not None else []
    rows_named += profile.since_firmware
    if protected.timeout is not None:
        rows_named += [protected.timeout.mode, protected.timeout.time]
    yield from (f"protected: {code} is no parameter" for code in rows_named if code not in profile.parameters)
    rows = (code for code in profile.alarm_rows if code not in profile.parameters)
    yield from (f"family.toml: {code} is no parameter" for code in rows)
    state = profile.state
    points = {*state.order, *state.ready, *state.starting, *state.waiting, state.adjusting} - {""}
    yield from (f"state: {name} is no point" for name in sorted(points - set(profile.points)))
    codes = [alarm.code for alarm in profile.alarms]
    yield from (f"alarms.csv: {code} stands twice" for code in sorted(set(codes)) if codes.count(code) > 1)


def _point(profile: Profile, name: str, point: Point) -> Iterator[str]:
    where = f"points.{name}"
    if bool(point.code) == bool(point.none_of):
        yield f"{where}: needs either a code or none_of"
    yield from (f"{where}: {other} is no point" for other in point.none_of if other not in profile.points)
    if not point.code:
        return
    row = profile.parameters.get(point.code)
    if row is None or row.access is Access.NONE:
        yield f"{where}: {point.code} is no parameter that can be read"
    elif row.type not in TYPE_LIMITS and (point.true_when or point.zero_is_missing):
        yield f"{where}: {point.code} is no number"
    if point.bit is not None and point.bit not in profile.bits.get(point.code, {}):
        yield f"{where}: {point.code} has no bit {point.bit}"


def _command(profile: Profile, verb: str) -> Iterator[str]:
    command = profile.commands[verb]
    where = f"commands.{verb}"
    for write in command.writes:
        yield from (f"{where}: {problem}" for problem in _write(profile, write))
    if command.verify is not None and command.verify.point not in profile.points:
        yield f"{where}: {command.verify.point} is no point"
    yield from (
        f"{where}: {code} is no parameter"
        for code in (*command.needs, *command.ceilings)
        if code not in profile.parameters
    )
    others = [f"{verb}_{flag}" for flag in command.flags]
    if command.args == ("value",) and not verb.endswith("_off"):
        others.append(f"{verb}_off")
    yield from (f"{where}: commands.{other} is missing" for other in others if other not in profile.commands)


def _output(profile: Profile, name: str, output: Output) -> Iterator[str]:
    where = f"outputs.{name}"
    rows = (output.word, output.function)
    yield from (f"{where}: {code} is no parameter" for code in rows if code not in profile.parameters)
    if (output.bit is None) == (output.full_scale is None):
        yield f"{where}: needs either a bit or full_scale"


def _write(profile: Profile, write: Write) -> Iterator[str]:
    if (write.coil is None) == (not write.word):
        yield "a write needs either a coil or a word"
    if write.coil is not None and not _is_command(profile.rows_at.get((Table.COIL, write.coil), ())):
        yield f"coil {write.coil} is not there for commands"
    if write.word:
        row = profile.parameters.get(write.word)
        if row is None or not _is_command((row,)):
            yield f"{write.word} is not there for commands"
        if write.mask_shift is None and (write.set_bits | write.clear_bits) & ~profile.command_bits.all:
            yield f"a bit that is written in {write.word} is none of command_bits"
    masks = (write.set_bits | write.clear_bits) << (write.mask_shift or 0)
    if write.set_bits & write.clear_bits or not 0 <= masks <= 0xFFFF:
        yield f"bits {write.set_bits:#x} and {write.clear_bits:#x} do not fit one word"


def _is_command(rows: tuple[Parameter, ...]) -> bool:
    return any(row.access is Access.COMMAND for row in rows)


def _limits(profile: Profile) -> Iterator[str]:
    limits = profile.limits
    for table in sorted({row.table for row in profile.parameters.values()}):
        function = READS[table].function
        if function not in limits.functions:
            yield f"limits.functions: the {table} table cannot be read without {function}"
    if _READ_OVERHEAD + 2 * limits.read_registers > limits.frame_bytes:
        yield f"limits.read_registers: {limits.read_registers} do not fit a frame"
    if _WRITE_OVERHEAD + 2 * limits.write_registers > limits.frame_bytes:
        yield f"limits.write_registers: {limits.write_registers} do not fit a frame"


def _history(profile: Profile) -> Iterator[str]:
    for code in profile.history.codes:
        row = profile.parameters.get(code)
        if row is None or row.access is Access.NONE:
            yield f"history: {code} is no row that can be read"
    if profile.history.thermal and not profile.thermal_point:
        yield f"history: thermal: there is no point of {profile.history.thermal}"
