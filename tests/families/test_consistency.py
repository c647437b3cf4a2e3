"""The parts of each profile fit together: every name that is used exists, every number fits.

A user cannot write a profile, so these rules hold of the data that are shipped, and of the guide's example.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, pairwise
from pathlib import Path

import pytest

import gateway.families
from gateway.contract import is_level
from gateway.families.profile.load import FAMILIES, LANGUAGES, read_profile, rows_of
from gateway.families.profile.parameters import READS
from gateway.families.profile.rows import Access, Parameter, Table, Type
from gateway.families.profile.schema import Command, Profile, Write
from gateway.families.profile.word_types import TYPE_LIMITS

PROFILES = Path(gateway.families.__file__).parent / "profiles"
FOLDERS = [*(PROFILES / family for family in FAMILIES), Path(__file__).parent / "acme"]
# How many words each type takes; a string takes what its row says.
TYPE_WORDS: dict[Type, int] = {
    **dict.fromkeys((*TYPE_LIMITS, Type.VERSION_LOW, Type.VERSION_HIGH), 1),
    **dict.fromkeys((Type.U32, Type.S32, Type.TIME, Type.IP_ADDRESS), 2),
    Type.MAC_ADDRESS: 3,
    Type.DATE: 4,
}
ENUM_TYPES = (Type.ENUM, Type.LOW_ENUM)
READ_OVERHEAD = 5  # bytes of a reply frame beside its words: unit, function, byte count, CRC
WRITE_OVERHEAD = 9  # bytes of an FC16 frame beside its words


@pytest.fixture(params=FOLDERS, ids=lambda folder: folder.name)
def folder(request: pytest.FixtureRequest) -> Path:
    return Path(request.param)


@pytest.fixture
def profile(folder: Path) -> Profile:
    return read_profile(folder)


def test_no_line_of_a_table_is_another_ones_or_for_nothing(folder: Path, profile: Profile) -> None:
    codes = [row["code"] for row in rows_of(folder / "parameters.csv")]

    assert len(codes) == len(profile.parameters)
    assert len(rows_of(folder / "alarms.csv")) == len(profile.alarms)
    for name, labels in (("enums", profile.enums), ("bits", profile.bits)):
        assert len(rows_of(folder / f"{name}.csv")) == sum(map(len, labels.values()))
    for name in ("ranges", "presets"):
        assert {row["code"] for row in rows_of(folder / f"{name}.csv")} <= set(codes)
    for language in LANGUAGES:
        translated = read_profile(folder, language)
        assert [labels.keys() for labels in translated.enums.values()] == [
            labels.keys() for labels in profile.enums.values()
        ]


def test_each_row_has_the_words_the_limits_and_the_labels_of_its_type(profile: Profile) -> None:
    for code, row in profile.parameters.items():
        assert code == code.upper()
        assert row.words == TYPE_WORDS.get(row.type, row.words), code
        assert row.table.is_bits == (row.type is Type.BIT), code
        assert row.type is Type.BIT or bool(row.enum) == (row.type in ENUM_TYPES), code
        assert not row.enum or row.enum in profile.enums, code
        assert row.type is not Type.BITS or code in profile.bits
        for low, high in ((row.raw_min, row.raw_max), *((one.raw_min, one.raw_max) for one in row.ranges)):
            lowest, highest = TYPE_LIMITS.get(row.type, (0, -1))
            assert (low is None) == (high is None), code
            assert low is None or high is None or lowest <= low <= high <= highest, code


def test_rows_overlap_only_as_aliases_of_the_same_register(profile: Profile) -> None:
    def place(row: Parameter) -> tuple[Table, int, Type]:
        return row.table, row.address, row.type

    rows = sorted(profile.parameters.values(), key=lambda row: (row.table, row.address, row.words))
    for one, other in pairwise(rows):
        are_apart = one.table is not other.table or one.address + one.words <= other.address
        assert are_apart or other.alias_of == one.code
    for row in rows:
        assert not row.alias_of or place(profile.parameters[row.alias_of]) == place(row)


def test_every_label_belongs_to_a_row_or_a_bit_of_one(profile: Profile) -> None:
    used = {row.enum for row in profile.parameters.values()}
    used |= {f"{code}.{bit}" for code, labels in profile.bits.items() for bit in labels}

    assert set(profile.enums) <= used
    assert {profile.parameters[code].type for code in profile.bits} <= {Type.BITS}
    assert set(chain.from_iterable(profile.bits.values())) <= set(range(16))


def test_every_row_that_is_named_is_there(profile: Profile) -> None:
    protected, local = profile.protected, profile.local_control
    kinds = (protected.command_sources, protected.waking, protected.connection, protected.actions)
    named = {profile.status_word, *profile.command_word, *profile.alarm_rows, *history_rows(profile)}
    named |= {*chain(*kinds, protected.password, profile.shown_by, profile.since_firmware)}
    named |= {each.code for each in profile.shown_by.values()} | ({local.code} if local else set())
    named |= {protected.timeout.mode, protected.timeout.time} if protected.timeout else set()
    named |= {code for each in profile.commands.values() for code in (*each.needs, *each.ceilings)}
    named |= {code for each in profile.outputs.values() for code in (each.word, each.function)}

    assert named - {""} <= set(profile.parameters)
    for output in profile.outputs.values():
        assert (output.bit is None) != (output.full_scale is None)


def test_every_point_that_is_named_is_there(profile: Profile) -> None:
    state = profile.state
    named = {*state.order, *state.ready, *state.starting, *state.waiting, state.adjusting}
    named |= {name for point in profile.points.values() for name in point.none_of}
    named |= {each.verify.point for each in profile.commands.values() if each.verify}

    assert named - {""} <= set(profile.points)
    assert profile.thermal_point or not profile.history.thermal


def test_every_point_is_a_row_that_can_be_read_a_bit_of_it_or_made_of_others(profile: Profile) -> None:
    for name, point in profile.points.items():
        assert is_level(name)
        assert bool(point.code) != bool(point.none_of), name
        if point.code:
            row = profile.parameters[point.code]
            assert row.access is not Access.NONE, name
            assert row.type in TYPE_LIMITS or not (point.true_when or point.zero_is_missing), name
            assert point.bit is None or point.bit in profile.bits[point.code], name
    for code in history_rows(profile):
        assert profile.parameters[code].access is not Access.NONE


def history_rows(profile: Profile) -> set[str]:
    named = profile.history.model_dump(exclude={"thermal_trip"}).values()
    return {code for each in named for code in ([each] if isinstance(each, str) else each) if code}


def test_every_write_goes_to_what_is_there_for_commands_and_fits_one_word(profile: Profile) -> None:
    for command in profile.commands.values():
        for write in command.writes:
            rows = (
                profile.rows_at[Table.COIL, write.coil]
                if write.coil is not None
                else (profile.parameters[write.word],)
            )
            assert (write.coil is None) != (not write.word)
            assert Access.COMMAND in {row.access for row in rows}
            assert list(wrong_bits(profile, write)) == []


def wrong_bits(profile: Profile, write: Write) -> Iterator[int]:
    """Yield the bits that a write sets and clears both, that lie outside the word or mean nothing in it."""
    bits = write.set_bits | write.clear_bits
    yield from filter(None, [write.set_bits & write.clear_bits, bits << (write.mask_shift or 0) & ~0xFFFF])
    if write.word and write.mask_shift is None and bits & ~profile.command_bits.all:
        yield bits & ~profile.command_bits.all


def test_each_variety_of_a_verb_has_its_entry(profile: Profile) -> None:
    def varieties(verb: str, command: Command) -> Iterator[str]:
        yield from (f"{verb}_{flag}" for flag in command.flags)
        if command.args == ("value",) and not verb.endswith("_off"):
            yield f"{verb}_off"

    for verb, command in profile.commands.items():
        assert set(varieties(verb, command)) <= set(profile.commands)


def test_every_table_can_be_read_and_the_longest_request_fits_a_frame(profile: Profile) -> None:
    limits = profile.limits

    assert {READS[row.table].function for row in profile.parameters.values()} <= set(limits.functions)
    assert READ_OVERHEAD + 2 * limits.read_registers <= limits.frame_bytes
    assert WRITE_OVERHEAD + 2 * limits.write_registers <= limits.frame_bytes
