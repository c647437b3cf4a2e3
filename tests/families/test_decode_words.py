"""Words of a block, of any table, shown by code with their points, bits and meanings."""

from __future__ import annotations

import json
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.families.profile.load import FAMILIES
from gateway.families.profile.rows import Table
from tests.families.decoding import shown

PLAIN = {"name": None, "point": None, "unit": "", "label": None}
COIL, HOLDING = Table.COIL, Table.HOLDING


def test_words_of_a_block_are_shown_by_code_with_their_points_and_bits() -> None:
    found = shown("ssw07", HOLDING, 5001, [0x8041])

    assert list(found) == ["VB01"]
    assert (found["VB01"]["point"], found["VB01"]["raw"]) == (None, [0x8041])
    bits = {bit["bit"]: bit for bit in found["VB01"]["bits"]}
    running = {"bit": 0, "label": "Running", "point": "running", "value": True, "meaning": "motor running"}
    assert bits[0] == running
    assert bits[6] == {"bit": 6, "label": "Reserved", "point": None, "value": True, "meaning": None}
    assert 13 not in bits  # a reserved one is shown because it is set


def test_coils_of_the_ssw07_are_bits_of_its_words() -> None:
    found = shown("ssw07", COIL, 0, [1, 0, 0, 0, 0, 0, 0, 0, 1] + [0] * 7 + [1])

    running = {"name": "Running", "point": "running", "value": True, "label": "motor running", "raw": [1]}
    assert found["VB01.0"] == {**running, "unit": ""}
    assert (found["VB01.8"]["point"], found["VB01.6"]["point"]) == ("remote", None)
    assert found["COIL16"] == {**PLAIN, "value": True, "raw": [1]}
    assert list(shown("ssw07", COIL, 100, [1])) == ["VB03.0"]


def test_coils_of_the_sst_are_numbered_from_one() -> None:
    found = shown("sst", COIL, 24, [0, 1, 1])

    assert {code: (one["point"], one["value"]) for code, one in found.items()} == {
        "COIL25": (None, False),
        "COIL26": ("ready_to_start", True),
        "COIL27": (None, True),
    }


@pytest.mark.parametrize(
    ("family", "table", "start", "words", "codes"),
    [
        ("ssw900", HOLDING, 18, [1, 2, 3], "S1.6.3 HR19 HR20"),  # words that no row names
        ("sst", Table.INPUT, 42, [0, 9], "R42 IR43"),
        ("ssw07", HOLDING, 999, [7, 8], "P999 HR1000"),  # a parameter goes by its number
        ("ssw900", HOLDING, 24, [23], "HR24"),  # half of a long value is not taken for a whole one
        ("ssw900", HOLDING, 25, [0, 1, 0], "HR25 S1.1.1"),
        ("ssw900", HOLDING, 680, [1], "S3.1.3.1 S5.1.1"),  # a register with two codes
    ],
)
def test_words_go_by_their_codes(family: str, table: Table, start: int, words: list[int], codes: str) -> None:
    found = shown(family, table, start, words)

    assert sorted(found) == sorted(codes.split())
    for code, one in found.items():
        if code.startswith(("HR", "IR")):
            assert one == {**PLAIN, "value": one["value"], "raw": [one["value"]]}


def test_a_parameter_that_the_serial_manual_does_not_name_says_so() -> None:
    name = "not named in this manual"

    assert shown("ssw07", HOLDING, 102, [7]) == {"P102": {**PLAIN, "name": name, "value": 7, "raw": [7]}}


@pytest.mark.parametrize(
    ("family", "address", "code", "labels"),
    [
        ("ssw06", 8, "VB01.8", ("local", "remote")),
        ("ssw07", 12, "VB01.12", ("bypass open", "bypass closed")),
        ("ssw07", 13, "VB01.13", (None, None)),
        ("sst", 5, "COIL6", ("left", "right")),
        ("sst", 4, "COIL5", ("configuration not done", "configuration done")),
    ],
)
def test_a_coil_says_what_0_and_1_mean(
    family: str, address: int, code: str, labels: tuple[str | None, str | None]
) -> None:
    entries = [shown(family, COIL, address, [word])[code] for word in (0, 1)]

    assert tuple(one["label"] for one in entries) == labels
    assert [one["value"] for one in entries] == [False, True]


@pytest.mark.parametrize(
    ("family", "address", "code", "bit", "meanings"),
    [
        ("ssw900", 680, "S5.1.1", 6, ("Bypass open", "Bypass closed")),
        ("ssw07", 5001, "VB01", 11, ("CW", "CCW")),
        ("ssw06", 5006, "VB06", 1, ("normal operation", "in adjusting mode after P202 was changed")),
    ],
)
def test_each_bit_of_a_word_says_what_it_means(
    family: str, address: int, code: str, bit: int, meanings: tuple[str, str]
) -> None:
    for number, meaning in enumerate(meanings):
        bits = shown(family, HOLDING, address, [number << bit])[code]["bits"]
        assert next(one["meaning"] for one in bits if one["bit"] == bit) == meaning


@given(data=st.data())
def test_any_words_can_be_shown(data: st.DataObject) -> None:
    table = data.draw(st.sampled_from(list(Table)))
    words = st.integers(0, 1 if table is COIL else 0xFFFF)
    run = data.draw(st.lists(words, min_size=1, max_size=40))

    found = shown(data.draw(st.sampled_from(FAMILIES)), table, data.draw(st.integers(0, 1200)), run)

    raw = [word for one in found.values() for word in one["raw"]]
    assert Counter(run) <= Counter(raw)  # a register with two codes stands twice
    assert json.loads(json.dumps(found, allow_nan=False)) == found
