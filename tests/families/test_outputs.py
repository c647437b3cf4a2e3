"""Relays and analog outputs (S6-12, S6-13, S7-08, S9-22)."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.errors import CommandError
from gateway.families.command.build import prepare, verbs
from gateway.families.profile.load import load_profile
from tests.families.starters import SLOT_1, built, frames, words


def to(output: str, value: object) -> dict[str, object]:
    return {"output": output, "value": value}


def refusal(family: str, args: dict[str, Any]) -> CommandError:
    with pytest.raises(CommandError) as caught:
        prepare(load_profile(family), SLOT_1, "output", args)
    return caught.value


def test_each_family_has_the_outputs_of_its_manual() -> None:
    assert list(load_profile("ssw06").outputs) == ["RL1", "RL2", "RL3", "AO1", "AO2"]
    assert list(load_profile("ssw07").outputs) == ["RL1", "RL2"]
    assert list(load_profile("ssw900").outputs) == ["DO1", "DO2", "DO3", "AO1"]
    assert "output" not in verbs(load_profile("sst"))


@pytest.mark.parametrize(
    ("output", "value", "before", "after"),
    [("RL1", True, 0b100, 0b101), ("RL3", "off", 0b111, 0b011), ("rl2", 1, 0xFFF8, 0b010)],
)
def test_a_relay_changes_its_bit_and_no_other(output: str, value: object, before: int, after: int) -> None:
    assert words(built("ssw06", "output", to(output, value), VB08=before)) == [(5008, after)]


def test_a_relay_is_not_written_while_the_others_are_unknown() -> None:
    with pytest.raises(CommandError, match="word_unknown"):
        built("ssw06", "output", to("RL1", True))


@pytest.mark.parametrize(("value", "pdu"), [(True, "16 02 B7 FF FD 00 02"), (False, "16 02 B7 FF FD 00 00")])
def test_an_ssw900_changes_the_one_bit_itself(value: bool, pdu: str) -> None:
    (frame,) = frames("ssw900", "output", to("DO2", value), S5_3_1=0b101 if value else 0b111)

    assert frame[3:-6] == pdu


@pytest.mark.parametrize(
    ("family", "output", "value", "expected"),
    [
        ("ssw06", "AO1", 50, (5009, 8191)),  # ssw06-es 5.4.6
        ("ssw06", "AO2", 25, (5010, 4095)),
        ("ssw06", "AO1", 100.0, (5009, 16383)),
        ("ssw06", "AO1", 0, (5009, 0)),
        ("ssw900", "AO1", 100, (696, 1023)),
        ("ssw900", "AO1", 50, (696, 511)),
    ],
)
def test_percent_become_the_number_of_the_manual(
    family: str, output: str, value: float, expected: tuple[int, int]
) -> None:
    assert words(built(family, "output", to(output, value))) == [expected]


def test_an_output_is_read_back_from_its_word() -> None:
    relay = built("ssw06", "output", to("RL2", True), VB08=0).verify
    analog = built("ssw06", "output", to("AO1", 50)).verify

    assert relay is not None
    assert relay.is_met({"VB08": (0b110,)})
    assert not relay.is_met({"VB08": (0b101,)})
    assert analog is not None
    assert analog.is_met({"VB09": (8191,)})
    assert not analog.is_met({"VB09": (8190,)})


def test_an_output_that_stands_so_already_is_not_written() -> None:
    procedure = built("ssw06", "output", to("RL2", True), VB08=0b010)

    assert (procedure.is_unchanged, procedure.steps, procedure.subject) == (True, (), "VB08")


@pytest.mark.parametrize(("output", "function"), [("DO1", "C4_2_1"), ("DO3", "C4_2_3"), ("AO1", "C4_3_1")])
def test_an_output_of_an_ssw900_must_be_set_to_communication(output: str, function: str) -> None:
    option = 9 if output == "AO1" else 12
    value = 50 if output == "AO1" else True

    assert built("ssw900", "output", to(output, value), **{function: option}).steps
    with pytest.raises(CommandError, match=rf"not_set_to_serial: .* is 1 \(.+\), not {option} \("):
        built("ssw900", "output", to(output, value), **{function: 1})


def test_where_the_number_of_the_option_is_not_printed_the_result_says_what_it_does_not_prove() -> None:
    procedure = built("ssw07", "output", to("RL1", True), VB08=0, P277=3)

    assert (
        "RL1 follows VB08 only if P277 (relay RL1 function) is set to Serial, which reads 3" in procedure.note
    )
    assert "reads" not in built("ssw06", "output", to("AO1", 5)).note
    assert built("ssw900", "output", to("DO1", True)).note == ""


def test_the_word_and_the_function_are_read_first() -> None:
    reads = prepare(load_profile("ssw06"), SLOT_1, "output", to("RL1", True)).reads

    assert [read.codes for read in reads] == [("P277",), ("VB08",)]


@pytest.mark.parametrize(
    ("args", "code", "text"),
    [
        (to("RL9", True), "bad_arguments", "RL1, RL2, RL3, AO1, AO2"),
        (to("RL1", 50), "bad_value", "true or false"),
        (to("AO1", True), "bad_value", "0..100 %"),
        (to("AO1", "half"), "bad_value", "0..100 %"),
        (to("AO1", 100.1), "out_of_range", "0..100 %"),
        (to("AO1", -1), "out_of_range", "0..100 %"),
        ({"output": "RL1"}, "bad_arguments", "value is missing"),
    ],
)
def test_what_is_no_output_or_no_value_of_it_is_refused_with_what_is_allowed(
    args: dict[str, Any], code: str, text: str
) -> None:
    error = refusal("ssw06", args)

    assert error.code == code
    assert text in error.text
