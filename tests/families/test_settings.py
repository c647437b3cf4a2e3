from __future__ import annotations

from typing import Any

import pytest

from gateway.errors import CommandError
from gateway.families.command.build import build, prepare
from gateway.families.profile.load import load_profile
from gateway.families.profile.procedure import REFUSALS, Preparation
from gateway.families.profile.rows import Access, Table
from gateway.families.profile.schema import Profile
from gateway.families.reading import rows_in
from tests.families.starters import SLOT_1, built, frame, frames


def to(parameter: str, value: object) -> dict[str, object]:
    return {"parameter": parameter, "value": value}


def prepared(family: str, verb: str, args: dict[str, Any]) -> Preparation:
    return prepare(load_profile(family), SLOT_1, verb, args)


def refusal(family: str, args: dict[str, Any], verb: str = "set") -> str:
    with pytest.raises(CommandError) as caught:
        prepared(family, verb, args)
    assert caught.value.code in REFUSALS
    return caught.value.code


def test_a_read_is_one_request_and_writes_nothing() -> None:
    preparation = prepared("ssw07", "read", {"parameter": "p003"})
    procedure = built("ssw07", "read", {"parameter": "p003"})

    assert [(frame(read.request), read.codes) for read in preparation.reads] == [
        ("01 03 00 03 00 01 74 0A", ("P003",))
    ]
    assert (procedure.steps, procedure.verify, procedure.subject) == ((), None, "P003")


def test_a_row_that_the_serial_manual_does_not_describe_is_read_as_a_raw_word() -> None:
    profile = load_profile("ssw07")
    (read,) = prepared("ssw07", "read", {"parameter": "P500"}).reads

    assert rows_in(profile, read, (7,)) == {"P500": (7,)}


def test_a_row_of_two_words_is_read_whole() -> None:
    (read,) = prepared("ssw900", "read", {"parameter": "S1.1.4"}).reads

    assert frame(read.request) == "01 03 00 18 00 02 44 0C"
    assert rows_in(load_profile("ssw900"), read, (1, 2)) == {"S1.1.4": (1, 2)}


@pytest.mark.parametrize(
    ("family", "code", "expected"),
    [
        ("ssw06", "P200", "not_readable"),
        ("ssw06", "X1", "unknown_parameter"),
        ("sst", "P003", "unknown_parameter"),
    ],
)
def test_a_row_that_cannot_be_read_is_refused(family: str, code: str, expected: str) -> None:
    assert refusal(family, {"parameter": code}, "read") == expected


def test_a_set_reads_the_row_first_and_writes_it_once() -> None:
    preparation = prepared("ssw07", "set", to("P314", 5))
    procedure = built("ssw07", "set", to("P314", 5), P314=0)

    assert [read.codes for read in preparation.reads] == [("P314",)]
    assert [frame(step.request) for step in procedure.steps] == ["01 06 01 3A 00 05 68 38"]
    assert procedure.subject == "P314"
    assert procedure.verify is not None
    assert (procedure.verify.name, procedure.verify.within_s) == ("P314", 2.0)
    assert procedure.verify.is_met({"P314": (5,)})
    assert not procedure.verify.is_met({"P314": (0,)})
    assert not procedure.verify.is_met({})


def test_a_value_that_the_starter_holds_already_is_not_written() -> None:
    procedure = built("ssw07", "set", to("P314", 5), P314=5)

    assert procedure.is_unchanged
    assert procedure.steps == ()


def test_without_a_reading_the_value_is_written() -> None:
    assert frames("ssw07", "set", to("P314", 5)) == ["01 06 01 3A 00 05 68 38"]


def test_a_row_of_32_bits_is_written_in_one_request_low_word_first() -> None:
    profile = load_profile("ssw900")
    wide = next(
        row for row in profile.parameters.values() if row.raw_max and row.is_writable and row.words == 2
    )
    limit = wide.raw_max or 0
    value = limit / 10 ** (wide.decimals or 0)

    (step,) = built("ssw900", "set", to(wide.code, value)).steps

    assert step.request.encode()[0] == 16
    assert step.request.encode()[6:] == (limit & 0xFFFF).to_bytes(2, "big") + (limit >> 16).to_bytes(2, "big")


@pytest.mark.parametrize(
    ("family", "args", "code"),
    [
        ("ssw07", to("P308", 7), "would_cut_connection"),
        ("ssw06", to("P312", 2), "would_cut_connection"),
        ("ssw900", to("C8.2.1", 1), "would_cut_connection"),
        ("ssw900", to("c8.2.2", 7), "would_cut_connection"),
        ("ssw900", to("C8.2.3", 1), "would_cut_connection"),
        ("ssw900", to("C8.2.4", 1), "would_cut_connection"),
        ("ssw07", to("VB03", 1), "not_writable"),
        ("ssw06", to("VB07", 1), "not_writable"),
        ("ssw06", to("VB03.0", 1), "not_writable"),
        ("ssw900", to("S5.2.1", 1), "not_writable"),
        ("ssw900", to("S5.2.5", 19), "not_writable"),
        ("ssw900", to("S5.2.6", 19), "not_writable"),
        ("sst", to("COIL1", 1), "not_writable"),
        ("sst", to("COIL2", 1), "not_writable"),
        ("ssw06", to("P000", 5), "not_writable"),
        ("ssw07", to("P003", 5), "not_writable"),
        ("ssw07", to("P314", 1000), "out_of_range"),
        ("ssw07", to("P314", "soon"), "bad_value"),
        ("sst", to("R41", 0x0130), "out_of_range"),
        ("sst", to("R30", 999), "out_of_range"),
    ],
)
def test_what_must_not_be_set_is_refused_before_anything_is_read(
    family: str, args: dict[str, Any], code: str
) -> None:
    assert refusal(family, args) == code


def stopped_only(profile: Profile) -> str:
    return next(row.code for row in profile.parameters.values() if row.is_writable and row.is_stopped_only)


def test_a_row_with_the_property_stopped_demands_a_motor_at_rest() -> None:
    profile = load_profile("ssw900")
    row = profile.parameters[stopped_only(profile)]

    preparation = prepared("ssw900", "set", to(row.code, (row.raw_min or 0) / 10 ** (row.decimals or 0)))

    assert preparation.requires == ("is_stopped",)
    assert [read.codes for read in preparation.reads] == [(row.code,), ("S5.1.1",)]


def test_a_timeout_is_made_active_only_when_its_time_is_known_and_not_zero() -> None:
    arm = to("C8.2.5.1", 2)

    assert [read.codes for read in prepared("ssw900", "set", arm).reads] == [("C8.2.5.1",), ("C8.2.5.3",)]
    assert built("ssw900", "set", arm, C8_2_5_1=0, C8_2_5_3=50).steps
    for rows in ({}, {"C8_2_5_3": 0}):
        with pytest.raises(CommandError, match="timeout_unset"):
            built("ssw900", "set", arm, C8_2_5_1=0, **rows)


def test_a_timeout_is_made_inactive_at_any_time() -> None:
    assert built("ssw900", "set", to("C8.2.5.1", 0), C8_2_5_1=1).steps


def test_the_time_of_a_timeout_becomes_zero_only_while_it_is_known_to_be_inactive() -> None:
    clear = to("C8.2.5.3", 0.0)

    assert built("ssw900", "set", clear, C8_2_5_1=0, C8_2_5_3=50).steps
    assert built("ssw900", "set", to("C8.2.5.3", 5.0), C8_2_5_1=1).steps
    for rows in ({}, {"C8_2_5_1": 1}):
        with pytest.raises(CommandError, match="timeout_unset"):
            built("ssw900", "set", clear, C8_2_5_3=50, **rows)


def test_no_coil_and_no_command_row_of_any_family_can_be_set() -> None:
    for family in ("ssw06", "ssw07", "ssw900", "sst"):
        profile = load_profile(family)
        for row in profile.parameters.values():
            if row.table is Table.COIL or row.access is Access.COMMAND:
                with pytest.raises(CommandError):
                    build(profile, SLOT_1, "set", to(row.code, 1), seen={})
