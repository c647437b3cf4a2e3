"""Registers and coils that no manual names, read as raw words."""

from __future__ import annotations

import pytest

from gateway.errors import CommandError
from gateway.families.command.build import build, prepare
from gateway.families.profile.decode import decode_row
from gateway.families.profile.load import load_profile
from gateway.families.profile.parameters import find
from gateway.families.profile.rows import Table
from gateway.families.profile.schema import Variant
from gateway.families.reading import rows_in
from gateway.modbus.reads import ReadDiscreteInputs, ReadHoldingRegisters
from tests.families.starters import SLOT_1


@pytest.mark.parametrize(
    ("family", "code", "table", "address"),
    [
        ("ssw900", "HR1600", Table.HOLDING, 1600),
        ("ssw900", "hr20000", Table.HOLDING, 20000),
        ("ssw900", "COIL100", Table.COIL, 100),
        ("ssw900", "DI7", Table.DISCRETE, 7),
        ("ssw07", "HR5002", Table.HOLDING, 5002),
        ("sst", "IR60", Table.INPUT, 60),
        ("sst", "COIL27", Table.COIL, 26),
    ],
)
def test_any_address_has_a_code(family: str, code: str, table: Table, address: int) -> None:
    row = find(load_profile(family), code)

    assert (row.code, row.table, row.address, row.words) == (code.upper(), table, address, 1)


@pytest.mark.parametrize(("code", "named"), [("HR680", "S5.1.1"), ("HR1300", "C8.1.1.5")])
def test_an_address_that_the_manual_names_is_its_row(code: str, named: str) -> None:
    assert find(load_profile("ssw900"), code).address == find(load_profile("ssw900"), named).address
    assert find(load_profile("ssw900"), code).code != code


def test_a_marker_is_read_as_it_is() -> None:
    profile = load_profile("ssw900")
    args = {"parameters": ["HR1600", "S5.1.1"]}
    status, marker = prepare(profile, SLOT_1, "read", args).reads

    rows = rows_in(profile, marker, (4711,))

    assert (marker.request, status.request) == (ReadHoldingRegisters(1600, 1), ReadHoldingRegisters(680, 1))
    assert decode_row(profile, Variant(), find(profile, "HR1600"), rows["HR1600"]).value == 4711
    assert build(profile, SLOT_1, "read", args, seen={}).subjects == ("HR1600", "S5.1.1")


@pytest.mark.parametrize(
    ("family", "code"),
    [
        ("ssw900", "HR65536"),
        ("ssw900", "IR5"),
        ("sst", "HR5"),
        ("sst", "COIL0"),
        ("ssw07", "HR"),
        ("ssw07", "DI1"),
    ],
)
def test_what_cannot_be_asked_for_has_none(family: str, code: str) -> None:
    with pytest.raises(CommandError) as error:
        find(load_profile(family), code)

    assert error.value.code == "unknown_parameter"


def test_a_discrete_input_is_read_by_function_02_and_is_a_bit() -> None:
    profile = load_profile("ssw900")
    args = {"parameters": ["DI7", "DI9"]}
    reads = prepare(profile, SLOT_1, "read", args).reads

    assert [read.request for read in reads] == [ReadDiscreteInputs(7, 1), ReadDiscreteInputs(9, 1)]
    assert rows_in(profile, reads[0], (True,)) == {"DI7": (1,)}
    assert decode_row(profile, Variant(), find(profile, "DI7"), (1,)).value is True


@pytest.mark.parametrize(
    ("family", "code", "function"),
    [
        ("ssw06", "DI1", "02"),
        ("ssw07", "di1", "02"),
        ("sst", "DI1", "02"),
        ("ssw900", "IR5", "04"),
        ("sst", "HR5", "03"),
    ],
)
def test_a_table_that_the_manual_does_not_give_is_named_by_its_function(
    family: str, code: str, function: str
) -> None:
    with pytest.raises(CommandError, match=f"Modbus function {function}, which the manual of the") as error:
        find(load_profile(family), code)

    assert error.value.code == "unknown_parameter"


@pytest.mark.parametrize("code", ["HR1600", "HR20000", "COIL9", "HR685", "DI7"])
def test_they_are_never_written(code: str) -> None:
    with pytest.raises(CommandError) as error:
        prepare(load_profile("ssw900"), SLOT_1, "set", {"parameter": code, "value": 1})

    assert error.value.code == "not_writable"
