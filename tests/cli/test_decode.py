from __future__ import annotations

import json
from typing import Any

import pytest

from gateway.cli.main import main


def decode(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    assert main(["decode", *words]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert isinstance(shown, dict)
    return shown


def test_the_manuals_example_is_decoded(capsys: pytest.CaptureFixture[str]) -> None:
    shown = decode(capsys, "ssw07", "holding", "2", "500", "400")  # ssw07 5.4.2

    names = [row.pop("name") for row in shown.values()]
    assert names == ["motor current, % of motor nominal", "motor current"]
    assert shown == {
        "P002": {"point": "current_pct", "value": 50.0, "unit": "%", "label": None, "raw": [500]},
        "P003": {"point": "current", "value": 40.0, "unit": "A", "label": None, "raw": [400]},
    }


def test_numbers_may_be_hexadecimal(capsys: pytest.CaptureFixture[str]) -> None:
    assert decode(capsys, "ssw07", "holding", "0x2", "0x1F4")["P002"]["value"] == 50.0


def test_the_model_decides_about_currents(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("ssw06", "holding", "3", "1234")

    assert decode(capsys, *words)["P003"]["value"] is None
    assert decode(capsys, *words, "--model", "SSW-06 85A")["P003"]["value"] == 123.4
    assert decode(capsys, *words, "--model", "SSW-06 820A")["P003"]["value"] == 1234.0


def test_coils_are_bits(capsys: pytest.CaptureFixture[str]) -> None:
    shown = decode(capsys, "sst", "coil", "4", "1")

    assert (shown["COIL5"]["point"], shown["COIL5"]["value"]) == ("configured", True)


def test_input_registers_are_those_of_the_sst(capsys: pytest.CaptureFixture[str]) -> None:
    assert decode(capsys, "sst", "input", "13", "0x00FF")["R13"]["value"] == -1.0  # ST register 13 is signed


NAME = [0x5353, 0x5433, 0x3330, 0x692D, 0x4D2D, 0x4553, 0, 0]  # "SST330i-M-ES"


@pytest.mark.parametrize("is_swapped", [False, True])
def test_name_version_and_serial_number_of_an_sst_are_joined_in_both_byte_orders(
    capsys: pytest.CaptureFixture[str], *, is_swapped: bool
) -> None:
    words = [(word & 0xFF) << 8 | word >> 8 if is_swapped else word for word in NAME]
    name = decode(capsys, "sst", "input", "R22", *map(str, words))["R22-R29"]
    shown = decode(
        capsys, "sst", "input", "R2", "0x0204", "1", "0", "0", "0", "0", "0x0007", "0xA120", "0", "0"
    )

    assert (name["point"], name["value"], name["raw"]) == ("name", "SST330i-M-ES", words)
    assert shown["R2-R3"]["value"] == "4.21"
    assert shown["R8-R11"]["value"] == "500000"


def test_a_part_of_what_belongs_together_is_not_joined(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(decode(capsys, "sst", "input", "2", "0x0204")) == ["R2"]


def test_a_code_may_stand_for_the_address(capsys: pytest.CaptureFixture[str]) -> None:
    assert decode(capsys, "ssw07", "holding", "p003", "815")["P003"]["value"] == 81.5
    assert list(decode(capsys, "ssw900", "holding", "S1.1.4", "1", "0")) == ["S1.1.4"]
    assert list(decode(capsys, "sst", "coil", "COIL5", "1")) == ["COIL5"]


@pytest.mark.parametrize(("word", "percent"), [("0", 0.0), ("4095", 25.0), ("8191", 50.0), ("16383", 100.0)])
def test_the_analog_outputs_of_an_ssw06_are_in_per_cent(
    word: str, percent: float, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = decode(capsys, "ssw06", "holding", "VB09", word, word)

    assert [(each["value"], each["unit"]) for each in shown.values()] == [(percent, "%")] * 2


@pytest.mark.parametrize(
    ("words", "reported"),
    [
        (("ssw07", "holding", "R13", "1"), "WEG SSW-07/SSW-08 has no 'R13'"),
        (("ssw07", "input", "P003", "1"), "P003 is in the table holding, not input"),
        (("ssw7", "holding", "0", "1"), "no family 'ssw7'"),
        (("ssw07", "discrete", "0", "1"), "no table 'discrete' (holding, input or coil)"),
        (("ssw07", "holding", "x", "1"), "START 'x' is no number"),
        (("ssw07", "holding", "65536", "1"), "START 65536 is out of range (0..65535)"),
        (("ssw07", "holding", "0", "65536"), "WORD 65536 is out of range (0..65535)"),
        (("ssw07", "coil", "0", "2"), "WORD 2 is out of range (0..1)"),
        (("ssw07", "holding", "65535", "1", "2"), "2 words do not fit behind START 65535"),
    ],
)
def test_wrong_words_are_reported(
    words: tuple[str, ...], reported: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["decode", *words]) == 2

    assert reported in capsys.readouterr().err
