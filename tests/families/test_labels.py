"""What a number is called in the manual: members, bits, faults and alarms, versions, names."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.families.profile.decode import Decoded, decode_points, decode_row, decode_words
from gateway.families.profile.load import load_profile
from gateway.families.profile.parameters import find
from gateway.families.profile.rows import Table
from gateway.families.profile.schema import Variant

UNKNOWN = Variant()


def decoded(family: str, code: str, *words: int) -> Decoded:
    profile = load_profile(family)
    return decode_row(profile, UNKNOWN, find(profile, code), words)


def shown(family: str, table: Table, start: int, *words: int) -> dict[str, dict[str, Any]]:
    return decode_words(load_profile(family), UNKNOWN, table, start, words)


@pytest.mark.parametrize(
    ("family", "code", "number", "label"),
    [
        ("ssw900", "D1.1.1", 128, "F128 Serial communication timeout"),
        ("ssw900", "D2.1.3", 128, "A128 Serial communication timeout"),
        ("ssw900", "D1.1.1", 999, "F999 (not in the manual)"),
        ("ssw900", "D1.1.1", 0, None),
        ("ssw07", "P014", 28, "E28 Serial communication inactive"),
        ("ssw07", "P017", 5, "E05 Motor overload"),
    ],
)
def test_a_fault_or_an_alarm_is_called_by_its_code_and_its_name(
    family: str, code: str, number: int, label: str | None
) -> None:
    assert decoded(family, code, number).value == number
    assert decoded(family, code, number).label == label


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
    entries = [shown(family, Table.COIL, address, word)[code] for word in (0, 1)]

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
    for value, meaning in enumerate(meanings):
        bits = shown(family, Table.HOLDING, address, value << bit)[code]["bits"]
        assert next(one["meaning"] for one in bits if one["bit"] == bit) == meaning


def test_a_point_that_is_a_coil_is_a_plain_boolean() -> None:
    points = decode_points(load_profile("sst"), UNKNOWN, {"COIL6": (1,)})

    assert points["coil6"] == Decoded(value=True, label=None, unit="", raw=(1,))


@pytest.mark.parametrize(
    ("code", "word", "text"),
    [
        ("R1", 0x0106, "6.1"),
        ("R1", 0x0003, "3.0"),
        ("R2", 0x0204, "4.2"),
        ("R7", 0x0100, "1.00"),
        ("R7", 0x0101, "1.01"),
        ("R22", 0x5353, "SS"),
        ("R29", 0x4D00, "M"),
    ],
)
def test_versions_and_the_name_of_an_sst_read_as_the_manual_writes_them(
    code: str, word: int, text: str
) -> None:
    assert decoded("sst", code, word) == Decoded(value=text, label=None, unit="", raw=(word,))


def test_a_timeout_of_zero_is_off_only_where_the_manual_says_so() -> None:
    """P314 = 0 is (ssw06-es 2.4); of C8.2.5.3 nothing is said: C8.2.5.1 = 0 is Inactive (ssw900)."""
    assert decoded("ssw06", "P314", 0).label == "off"
    assert decoded("ssw900", "C8.2.5.3", 0).label is None
    assert decoded("ssw900", "C8.2.5.1", 0).label == "Inactive"
