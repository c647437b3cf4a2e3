"""The rules between the parts of a profile: every name used exists, every number fits."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from gateway.families.profile.parameters import READS
from gateway.families.profile.rows import Access, Parameter, Table, Type
from gateway.families.profile.schema import Point, Profile, Write
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
        *(
            f"outputs.{name}: needs either a bit or full_scale"
            for name, output in profile.outputs.items()
            if (output.bit is None) == (output.full_scale is None)
        ),
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
    """Name every row and point that another part names, and that is not there."""
    protected, state, commands = profile.protected, profile.state, profile.commands
    kinds = (protected.command_sources, protected.waking, protected.connection, protected.actions)
    guarded = [code for kind in (*kinds, protected.password, profile.shown_by) for code in kind]
    guarded += [each.code for each in profile.shown_by.values()] + list(profile.since_firmware)
    guarded += [protected.timeout.mode, protected.timeout.time] if protected.timeout is not None else []
    guarded += [profile.local_control.code] if profile.local_control is not None else []
    rows = {
        "family.toml": (profile.status_word, *profile.command_word, *profile.alarm_rows),
        "protected": guarded,
        **{f"commands.{verb}": (*each.needs, *each.ceilings) for verb, each in commands.items()},
        **{f"outputs.{name}": (each.word, each.function) for name, each in profile.outputs.items()},
    }
    points = {
        "state": (*state.order, *state.ready, *state.starting, *state.waiting, state.adjusting),
        **{f"points.{name}": each.none_of for name, each in profile.points.items()},
        **{f"commands.{verb}": (each.verify.point,) for verb, each in commands.items() if each.verify},
    }
    for kind, named, known in (("parameter", rows, profile.parameters), ("point", points, profile.points)):
        for where, names in named.items():
            missing = (name for name in dict.fromkeys(names) if name and name not in known)
            yield from (f"{where}: {name} is no {kind}" for name in missing)
    codes = [alarm.code for alarm in profile.alarms]
    yield from (f"alarms.csv: {code} stands twice" for code in sorted(set(codes)) if codes.count(code) > 1)


def _point(profile: Profile, name: str, point: Point) -> Iterator[str]:
    where = f"points.{name}"
    if bool(point.code) == bool(point.none_of):
        yield f"{where}: needs either a code or none_of"
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
    others = [f"{verb}_{flag}" for flag in command.flags]
    if command.args == ("value",) and not verb.endswith("_off"):
        others.append(f"{verb}_off")
    yield from (f"{where}: commands.{other} is missing" for other in others if other not in profile.commands)


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
