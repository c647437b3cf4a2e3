from __future__ import annotations

import json
from typing import Any

import pytest

from gateway.cli import main


def decode(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    assert main(["decode", *words]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert isinstance(shown, dict)
    return shown


def test_the_manuals_example_is_decoded(capsys: pytest.CaptureFixture[str]) -> None:
    shown = decode(capsys, "ssw07", "holding", "2", "500", "400")  # ssw07 5.4.2

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


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("ssw7", "holding", "0", "1"), "no family 'ssw7'"),
        (("ssw07", "discrete", "0", "1"), "no table 'discrete' (holding, input or coil)"),
        (("ssw07", "holding", "x", "1"), "START 'x' is no number"),
        (("ssw07", "holding", "65536", "1"), "START 65536 is out of range (0..65535)"),
        (("ssw07", "holding", "0", "65536"), "WORD 65536 is out of range (0..65535)"),
        (("ssw07", "coil", "0", "2"), "WORD 2 is out of range (0..1)"),
        (("ssw07", "holding", "65535", "1", "2"), "2 words do not fit behind START 65535"),
    ],
)
def test_wrong_words_are_told(words: tuple[str, ...], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["decode", *words]) == 2

    assert told in capsys.readouterr().err
