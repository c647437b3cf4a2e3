"""What words mean: values with their decimals, points, texts, labels."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.families.profile.decode import Decoded, decode_points, decode_row
from gateway.families.profile.load import load_profile
from gateway.families.profile.parameters import find
from gateway.families.profile.schema import Variant


def decoded(family: str, code: str, *words: int, **known: Any) -> Decoded:
    """Return what a row says; `known` is the starter's variant."""
    profile = load_profile(family)
    found = decode_row(profile, Variant(**known), find(profile, code), words)
    assert found.raw == words
    return found


def points(family: str, rows: dict[str, tuple[int, ...]], **known: Any) -> dict[str, Any]:
    found = decode_points(load_profile(family), Variant(**known), rows)
    return {name: one.value for name, one in found.items()}


@pytest.mark.parametrize(
    ("family", "code", "known", "words", "expected"),
    [
        # an SSW-06 of 820 A and up sends whole amperes (S6-19), and of an unknown one nothing is said
        *[
            ("ssw06", "P003", {"model": model}, (1234,), 1234.0)
            for model in ("SSW-06 820A", "SSW-06 820.0A", "SSW-06 820", "SSW-06 1400A")
        ],
        *[("ssw06", "P003", {"model": f"SSW-06 {each}"}, (1234,), 123.4) for each in ("670A", "85.0A")],
        *[("ssw06", "P003", {"model": model}, (1234,), None) for model in (None, "SSW-06", "whatever")],
        ("ssw06", "P002", {"model": None}, (500,), 50.0),
        ("ssw06", "P003", {"model": "SSW-06 85A", "rated_current_a": 950.0}, (1234,), 1234.0),
        ("ssw07", "P003", {"model": "SSW-07 820A"}, (1234,), 123.4),
        # the SSW900: low word first, with the decimals of the column
        *[
            ("ssw900", code, {}, words, expected)
            for code, words, expected in (
                ("S5.1.1", (0x0063,), 0x63),
                ("S1.1.4", (0x0017, 0x0000), 2.3),
                ("S1.1.4", (0x0000, 0x0001), 6553.6),
                ("S1.5.4", (0x010E,), None),  # of eight bits
                ("S2.2.1", (10000,), 100.0),
                ("S2.2.2", (20000,), 20.0),
                ("S4.1.1", (0xFFEA,), -22.0),
                ("S3.2.2.2", (0xFFFF,), -1),
                ("C11.3.1", (0xFFFE, 0xFFFF), -2),
                ("D6.1", (1, 1), 65537.0),
                ("D4.7.1", (65535,), 65535),
                ("C7.3.2", (7,), 7),
                # dates, addresses and strings in the byte order that is plausible
                ("C6.3.1", (0x0E0F, 0x150D, 0x000B, 2026), "2026-11-21T13:14:15"),
                ("C6.3.1", (0x0F0E, 0x0D15, 0x0B00, 0xEA07), "2026-11-21T13:14:15"),
                ("C6.3.1", (0x3D3D, 0x150D, 0x000B, 2026), None),
                ("C6.3.1", (0, 0, 0, 0), None),
                ("C8.3.5", (0x0102, 0xC0A8), "192.168.1.2"),
                ("S5.9.1", (0x1A00, 0x3C2B, 0x5E4D), "00:1A:2B:3C:4D:5E"),
                ("S5.9.1", (0x011A, 0x2B3C, 0x4D5E), "1A:01:3C:2B:5E:4D"),
                ("S5.9.1", (0x1A01, 0x3C2B, 0x5E4D), "1A:01:3C:2B:5E:4D"),
                ("S5.9.1", (0x0101, 0, 0), None),
                ("C8.6.2", (0x3132, 0x3334, 0x3536, 0), "123456"),
                ("C8.6.3", (0x5075, 0x6D70, 0, 0, 0, 0, 0, 0), "Pump"),
                ("C8.6.3", (0x7550, 0x006D, 0, 0, 0, 0, 0, 0), "Pum"),  # only the end is filled up with 0
                ("C8.6.3", (0x0050, 0, 0, 0, 0, 0, 0, 0), "P"),
                ("C8.6.3", (0, 0, 0, 0, 0, 0, 0, 0), ""),
                ("C8.6.3", (0x0101, 0xFFFF, 0, 0, 0, 0, 0, 0), None),
            )
        ],
        # a measurement outside the range of table A.2 is impossible
        *[
            ("ssw900", code, {}, (word,), expected)
            for code, word, expected in (
                ("S4.3.6", 260, 260.0),
                ("S4.3.6", 300, None),
                ("S4.3.6", 0x10000 - 20, -20.0),
                ("S4.3.6", 0x10000 - 21, None),
                ("S1.6.2", 1000, None),
                ("C5.7.2", 9999, 999.9),  # a setting is what the starter holds
            )
        ],
        # the SST: the byte that carries the value, versions and its name as the manual writes them
        *[
            ("sst", code, {}, (word,), expected)
            for code, word, expected in (
                ("R13", 0x00FF, -1.0),
                ("R19", 0x0102, 2),
                ("R33", 0x0006, 0.6),
                ("R0", 0x014A, 330),
                ("COIL26", 1, True),
                ("COIL9", 0, False),
                ("R1", 0x0106, "6.1"),
                ("R1", 0x0003, "3.0"),
                ("R2", 0x0204, "4.2"),
                ("R7", 0x0100, "1.00"),
                ("R7", 0x0101, "1.01"),
                ("R22", 0x5353, "SS"),
                ("R29", 0x4D00, "M"),
            )
        ],
    ],
)
def test_words_have_the_value_of_the_manual(
    family: str, code: str, known: dict[str, Any], words: tuple[int, ...], expected: object
) -> None:
    found = decoded(family, code, *words, **known).value

    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize(
    ("family", "code", "number", "label"),
    [
        ("ssw900", "S3.1.2", 99, None),
        ("ssw900", "S3.1.2", 0, load_profile("ssw900").enums["S3.1.2"][0]),
        ("ssw900", "D1.1.1", 128, "F128 Serial communication timeout"),
        ("ssw900", "D2.1.3", 128, "A128 Serial communication timeout"),
        ("ssw900", "D1.1.1", 999, "F999 (not in the manual)"),
        ("ssw900", "D1.1.1", 0, None),
        ("ssw07", "P014", 28, "E28 Serial communication inactive"),
        ("ssw07", "P014", 99, "E99 (not in the manual)"),
        ("ssw07", "P014", 0, None),
        ("ssw07", "P017", 5, "E05 Motor overload"),
        # P314 = 0 is off (ssw06-es 2.4); of C8.2.5.3 nothing is said: C8.2.5.1 = 0 is Inactive (ssw900)
        ("ssw06", "P314", 0, "off"),
        ("ssw900", "C8.2.5.3", 0, None),
        ("ssw900", "C8.2.5.1", 0, "Inactive"),
        ("sst", "R1", 0x0106, None),
    ],
)
def test_a_number_has_the_label_of_the_manual(family: str, code: str, number: int, label: str | None) -> None:
    assert decoded(family, code, number).label == label


@pytest.mark.parametrize(
    ("family", "rows", "expected"),
    [
        ("sst", {"COIL7": (0,)}, {"coil7": False}),  # nothing is said of a point whose rows were not read
        ("sst", {"R18": (0,)}, {"line_voltage": None}),  # not available
        ("sst", {"R18": (400,)}, {"line_voltage": 400.0}),
    ],
)
def test_points_whose_rows_are_not_there_or_not_available(
    family: str, rows: dict[str, tuple[int, ...]], expected: dict[str, Any]
) -> None:
    assert points(family, rows) == expected


@pytest.mark.parametrize("firmware", ["V1.30", "1.3", "V1.40", "V1.4", "V2.05", None, "?"])
def test_bits_that_old_firmware_does_not_have_are_unknown_there(firmware: str | None) -> None:
    found = points("ssw07", {"VB01": (0xFFFF,)}, firmware=firmware)

    assert found["jog"] is (None if firmware in ("V1.30", "1.3") else True)
    assert found["running"] is True
