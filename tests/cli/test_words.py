from __future__ import annotations

import pytest

from gateway.cli.command import arguments, whole_number
from gateway.errors import UsageError


def test_values_are_numbers_truths_or_texts() -> None:
    given = [
        "a=1",
        "b=0x10",
        "c=-2.5",
        "d=true",
        "e=false",
        "f=S1.1.4",
        "g=",
        "h=a=b",
        "i=nan",
        "j=inf",
        "k=1e3",
    ]

    assert arguments(given) == {
        "a": 1,
        "b": 16,
        "c": -2.5,
        "d": True,
        "e": False,
        "f": "S1.1.4",
        "g": "",
        "h": "a=b",
        "i": "nan",
        "j": "inf",
        "k": 1000.0,
    }


@pytest.mark.parametrize("pairs", [["a"], ["=1"], ["a=1", "a=1"]])
def test_anything_else_is_no_argument(pairs: list[str]) -> None:
    with pytest.raises(UsageError):
        arguments(pairs)


@pytest.mark.parametrize(("text", "number"), [("0", 0), ("255", 255), ("0xff", 255), ("0b1", 1)])
def test_whole_numbers_may_be_written_in_several_ways(text: str, number: int) -> None:
    assert whole_number(text, "N", low=0, high=255) == number


@pytest.mark.parametrize("text", ["", "1.0", "x", "-1", "256", "٣"])
def test_what_is_no_whole_number_of_the_range_is_refused(text: str) -> None:
    with pytest.raises(UsageError):
        whole_number(text, "N", low=0, high=2 if text == "٣" else 255)
