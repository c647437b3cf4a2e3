"""Words of a block, of any table, shown by code."""

from __future__ import annotations

import json
from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from gateway.families.profile.decode import decode_words
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.rows import Table
from tests.families.decoding import UNKNOWN


def test_words_of_a_block_are_shown_by_code_with_their_points_and_bits() -> None:
    shown = decode_words(load_profile("ssw07"), UNKNOWN, Table.HOLDING, 5001, [0x8041])

    assert list(shown) == ["VB01"]
    assert shown["VB01"]["point"] is None
    assert shown["VB01"]["raw"] == [0x8041]
    bits = {bit["bit"]: bit for bit in shown["VB01"]["bits"]}
    running = {"bit": 0, "label": "Running", "point": "running", "value": True, "meaning": "motor running"}
    assert bits[0] == running
    assert bits[6]["label"] == "Reserved"  # shown because it is set
    assert (bits[6]["point"], bits[6]["value"], bits[6]["meaning"]) == (None, True, None)
    assert 13 not in bits


def test_coils_of_the_ssw07_are_bits_of_its_words() -> None:
    profile = load_profile("ssw07")

    shown = decode_words(profile, UNKNOWN, Table.COIL, 0, [1, 0, 0, 0, 0, 0, 0, 0, 1] + [0] * 7 + [1])

    running = {
        "name": "Running",
        "point": "running",
        "value": True,
        "unit": "",
        "label": "motor running",
        "raw": [1],
    }
    assert shown["VB01.0"] == running
    assert shown["VB01.8"]["point"] == "remote"
    assert shown["VB01.6"]["point"] is None
    assert shown["COIL16"] == {
        "name": None,
        "point": None,
        "value": True,
        "unit": "",
        "label": None,
        "raw": [1],
    }
    assert list(decode_words(profile, UNKNOWN, Table.COIL, 100, [1])) == ["VB03.0"]


def test_coils_of_the_sst_are_numbered_from_one() -> None:
    shown = decode_words(load_profile("sst"), UNKNOWN, Table.COIL, 24, [0, 1, 1])

    assert {code: (one["point"], one["value"]) for code, one in shown.items()} == {
        "COIL25": (None, False),
        "COIL26": ("ready_to_start", True),
        "COIL27": (None, True),
    }


def test_words_that_no_row_names_are_shown_raw() -> None:
    shown = decode_words(load_profile("ssw900"), UNKNOWN, Table.HOLDING, 18, [1, 2, 3])

    assert list(shown) == ["S1.6.3", "HR19", "HR20"]
    assert shown["HR19"] == {"name": None, "point": None, "value": 2, "unit": "", "label": None, "raw": [2]}
    assert list(decode_words(load_profile("sst"), UNKNOWN, Table.INPUT, 42, [0, 9])) == ["R42", "IR43"]


def test_parameters_that_the_serial_manual_does_not_name_go_by_their_number() -> None:
    shown = decode_words(load_profile("ssw07"), UNKNOWN, Table.HOLDING, 102, [7])

    assert shown["P102"].pop("name") == "not named in this manual"
    assert shown == {"P102": {"point": None, "value": 7, "unit": "", "label": None, "raw": [7]}}
    assert list(decode_words(load_profile("ssw07"), UNKNOWN, Table.HOLDING, 999, [7, 8])) == [
        "P999",
        "HR1000",
    ]


def test_half_of_a_long_value_is_not_taken_for_a_whole_one() -> None:
    profile = load_profile("ssw900")

    assert list(decode_words(profile, UNKNOWN, Table.HOLDING, 24, [23])) == ["HR24"]
    assert list(decode_words(profile, UNKNOWN, Table.HOLDING, 25, [0, 1, 0])) == ["HR25", "S1.1.1"]


def test_a_register_with_two_codes_is_shown_under_both() -> None:
    shown = decode_words(load_profile("ssw900"), UNKNOWN, Table.HOLDING, 680, [1])

    assert sorted(shown) == ["S3.1.3.1", "S5.1.1"]


@given(data=st.data())
def test_any_words_can_be_shown(data: st.DataObject) -> None:
    profile = load_profile(data.draw(st.sampled_from(FAMILIES)))
    table = data.draw(st.sampled_from(list(Table)))
    words = st.integers(0, 1 if table is Table.COIL else 0xFFFF)
    run = data.draw(st.lists(words, min_size=1, max_size=40))
    start = data.draw(st.integers(0, 1200))

    shown = decode_words(profile, UNKNOWN, table, start, run)

    raw = [word for one in shown.values() for word in one["raw"]]
    assert Counter(run) <= Counter(raw)  # a register with two codes stands twice
    assert json.loads(json.dumps(shown, allow_nan=False)) == shown
