"""The audit's hash chain: what is whole, and what shows that it is not."""

from __future__ import annotations

import enum
import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.store.chain import Head, canonical, link, read_line, verify


class Colour(enum.StrEnum):
    RED = "red"


def chain(count: int, head: Head = Head()) -> list[str]:  # noqa: B008 - frozen
    lines = []
    for number in range(count):
        line, head = link(head, {"what": f"entry {number}"})
        lines.append(line)
    return lines


def placed(lines: list[str]) -> list[tuple[str, str]]:
    return [(f"line {number}", line) for number, line in enumerate(lines, 1)]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ({"b": 1, "a": 2.0}, '{"a":2.0,"b":1}'),
        ({"t": (1, [True, None])}, '{"t":[1,[true,null]]}'),
        (Colour.RED, '"red"'),
        ("°C", '"°C"'),
        ("\ud800", '"?"'),
        (b"\x01", "\"b'\\\\x01'\""),
        ({1: "one"}, '{"1":"one"}'),
    ],
)
def test_a_value_has_one_canonical_text(value: Any, text: str) -> None:
    assert canonical(value) == text


def test_the_hash_is_sha_256_over_the_previous_hash_and_the_canonical_json() -> None:
    line, _ = link(Head(), {"what": "first"})

    # printf '%064d{"n":1,"what":"first"}' 0 | sha256sum
    assert json.loads(line)["hash"] == "1cce82bf4c562891f3db91553f352606fef3dfda2c58a057fd34fc731a0f0b44"


@given(st.integers(0, 4), st.data())
def test_no_changed_octet_goes_unnoticed(place: int, data: st.DataObject) -> None:
    lines = chain(5)
    position = data.draw(st.integers(0, len(lines[place]) - 1))
    other = data.draw(st.characters(exclude_characters=lines[place][position], codec="utf-8"))
    lines[place] = lines[place][:position] + other + lines[place][position + 1 :]

    assert verify(placed(lines), after=Head()).problems


def test_a_line_that_was_changed_with_its_own_hash_recomputed_breaks_the_next() -> None:
    lines = chain(5)
    _, before = read_line(lines[1])
    lines[2] = link(before, {"what": "forged"})[0]

    problems = verify(placed(lines), after=Head()).problems

    assert problems == ["line 4: does not follow line 3: something was removed, inserted or exchanged"]
