from __future__ import annotations

from typing import Any

import pytest

from gateway.families.profile.decode import (
    Decoded,
    decode_points,
    decode_row,
    decode_words,
    is_known,
    rated_current_a,
)
from gateway.families.profile.load import load_profile
from gateway.families.profile.parameters import find
from gateway.families.profile.rows import Table
from gateway.families.profile.schema import Point, Variant
from tests.families.decoding import UNKNOWN, value


def points(family: str, rows: dict[str, tuple[int, ...]], variant: Variant = UNKNOWN) -> dict[str, Any]:
    decoded = decode_points(load_profile(family), variant, rows)
    return {name: one.value for name, one in decoded.items()}


@pytest.mark.parametrize("family", ["ssw06", "ssw07"])
def test_the_example_of_both_serial_manuals_is_50_percent_and_40_amperes(family: str) -> None:
    profile = load_profile(family)
    variant = Variant(model=f"SSW-{family[3:]} 85A")

    shown = decode_words(profile, variant, Table.HOLDING, 2, [500, 400])

    assert shown["P002"]["value"] == 50.0
    assert shown["P003"] == {
        "name": "motor current",
        "point": "current",
        "value": 40.0,
        "unit": "A",
        "label": None,
        "raw": [400],
    }


@pytest.mark.parametrize("model", ["SSW-06 820A", "SSW-06 820.0A", "SSW-06 820", "SSW-06 1400A"])
def test_an_ssw06_of_820_a_and_up_sends_whole_amperes(model: str) -> None:
    assert value("ssw06", "P003", 1234, variant=Variant(model=model)) == 1234.0


@pytest.mark.parametrize("model", ["SSW-06 670A", "SSW-06 85.0A"])
def test_a_smaller_ssw06_sends_tenths(model: str) -> None:
    assert value("ssw06", "P003", 1234, variant=Variant(model=model)) == 123.4


@pytest.mark.parametrize("model", [None, "SSW-06", "whatever"])
def test_an_ssw06_of_unknown_current_gives_no_amperes_but_shows_the_raw_word(model: str | None) -> None:
    assert value("ssw06", "P003", 1234, variant=Variant(model=model)) is None
    assert value("ssw06", "P002", 500, variant=Variant(model=model)) == 50.0


def test_a_rated_current_that_was_identified_goes_before_the_models_text() -> None:
    variant = Variant(model="SSW-06 85A", rated_current_a=950.0)

    assert value("ssw06", "P003", 1234, variant=variant) == 1234.0


def test_the_ssw07_has_tenths_whatever_its_current() -> None:
    assert value("ssw07", "P003", 1234, variant=Variant(model="SSW-07 820A")) == 123.4


@pytest.mark.parametrize(
    ("model", "current_a"),
    [
        ("SSW-06 820.0A", 820.0),
        ("SSW-07 85A", 85.0),
        ("SSW-08 61,5 A", 61.5),
        ("WEG SSW-06 10A", 10.0),
        ("SST130i-75-M-ES", 75.0),
        ("SST330i-M", None),
        ("SSW-06", None),
        ("SSW-06 0A", None),
        ("", None),
    ],
)
def test_the_rated_current_is_the_number_after_the_familys_name(model: str, current_a: float | None) -> None:
    assert rated_current_a(model) == current_a


@pytest.mark.parametrize(
    ("code", "words", "shown"),
    [
        ("S5.1.1", (0x0063,), 0x63),
        ("S1.2.4", (0x088A,), 218.6),
        ("S1.1.4", (0x0017, 0x0000), 2.3),
        ("S1.1.4", (0x0000, 0x0001), 6553.6),
        ("S1.5.4", (0x000E,), 0.14),
        ("S2.2.1", (10000,), 100.0),
        ("S2.2.2", (20000,), 20.0),
        ("S4.1.1", (0xFFEA,), -22.0),
        ("S3.2.2.2", (0xFFFF,), -1),
        ("C11.3.1", (0xFFFE, 0xFFFF), -2),
        ("D6.1", (1, 1), 65537.0),
        ("D4.7.1", (65535,), 65535),
        ("C7.3.2", (7,), 7),
    ],
)
def test_ssw900_words_are_low_word_first_with_the_decimals_of_the_column(
    code: str, words: tuple[int, ...], shown: float
) -> None:
    decoded = value("ssw900", code, *words)

    assert decoded == shown
    assert type(decoded) is type(shown)


def test_an_eight_bit_value_with_a_high_byte_is_impossible() -> None:
    assert value("ssw900", "S1.5.4", 0x010E) is None


def test_a_listed_number_has_a_label_and_an_unlisted_one_is_still_shown() -> None:
    profile = load_profile("ssw900")
    row = find(profile, "S3.1.2")

    assert decode_row(profile, UNKNOWN, row, (99,)) == Decoded(99, label=None, unit="", raw=(99,))
    assert decode_row(profile, UNKNOWN, row, (0,)).label == profile.enums["S3.1.2"][0]


@pytest.mark.parametrize(
    ("code", "words", "text"),
    [
        # 2026-11-21 13:14:15, natural and with the bytes of each word swapped
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
    ],
)
def test_dates_addresses_and_strings_are_read_in_the_order_that_is_plausible(
    code: str, words: tuple[int, ...], text: str | None
) -> None:
    assert value("ssw900", code, *words) == text


@pytest.mark.parametrize(
    ("code", "word", "shown"),
    [
        ("R13", 0x00FF, -1.0),
        ("R13", 0x00FE, -2.0),
        ("R13", 0x001D, 29.0),
        ("R12", 0x0130, 48.0),  # the high byte says nothing
        ("R17", 0x001A, 26.0),
        ("R19", 0x0102, 2),
        ("R33", 0x0006, 0.6),
        ("R0", 0x014A, 330),
        ("COIL26", 1, True),
        ("COIL9", 0, False),
    ],
)
def test_sst_rows_use_the_byte_that_carries_the_value(code: str, word: int, shown: object) -> None:
    decoded = value("sst", code, word)

    assert decoded == shown
    assert type(decoded) is type(shown)


@pytest.mark.parametrize(
    ("status", "shown"),
    [
        (0, {"running": False, "accelerating": False, "full_voltage": False, "decelerating": False}),
        (1, {"running": True, "accelerating": True, "full_voltage": False, "decelerating": False}),
        (2, {"running": True, "accelerating": False, "full_voltage": True, "decelerating": False}),
        (3, {"running": False, "accelerating": False, "full_voltage": False, "decelerating": True}),
    ],
)
def test_the_motor_status_of_an_sst_says_whether_it_runs(status: int, shown: dict[str, bool]) -> None:
    assert points("sst", {"R19": (status,)}) == {**shown, "r19": status}


@pytest.mark.parametrize(
    ("usb", "inputs", "is_remote"), [(0, 0, True), (1, 0, False), (0, 1, False), (1, 1, False)]
)
def test_an_sst_is_remote_while_neither_usb_nor_its_inputs_control_it(
    usb: int, inputs: int, *, is_remote: bool
) -> None:
    assert points("sst", {"COIL7": (usb,), "COIL8": (inputs,)})["remote"] is is_remote


def test_nothing_is_said_of_a_point_whose_rows_were_not_read() -> None:
    assert points("sst", {"COIL7": (0,)}) == {"coil7": False}


def test_a_mains_voltage_of_zero_is_not_available_on_an_sst() -> None:
    assert points("sst", {"R18": (0,)}) == {"line_voltage": None}
    assert points("sst", {"R18": (400,)}) == {"line_voltage": 400.0}


def test_the_bits_of_a_status_word_are_points() -> None:
    shown = points("ssw07", {"VB01": (0x4103,)})

    assert {name for name, is_on in shown.items() if is_on} == {
        "running",
        "general_enabled",
        "remote",
        "power_present",
    }
    assert shown["fault"] is False


@pytest.mark.parametrize(
    ("firmware", "is_known"),
    [
        ("V1.30", False),
        ("1.3", False),
        ("V1.40", True),
        ("V1.4", True),
        ("V2.05", True),
        (None, True),
        ("?", True),
    ],
)
def test_bits_that_old_firmware_does_not_have_are_unknown_there(
    firmware: str | None, *, is_known: bool
) -> None:
    shown = points("ssw07", {"VB01": (0xFFFF,)}, Variant(firmware=firmware))

    assert shown["jog"] is (True if is_known else None)
    assert shown["running"] is True


def test_a_point_that_all_firmware_has_is_always_present() -> None:
    assert is_known(Point(code="VB01").since_firmware, Variant(firmware="V0.01"))


def test_a_combination_of_unknown_points_is_unknown_unless_one_is_true() -> None:
    profile = load_profile("ssw07")
    at_rest = Point(none_of=("running", "jog"), group="status")
    profile = profile.model_copy(update={"points": {**profile.points, "at_rest": at_rest}})
    old = Variant(firmware="V1.30")  # knows nothing of jog

    assert decode_points(profile, old, {"VB01": (0,)})["at_rest"].value is None
    assert decode_points(profile, old, {"VB01": (1,)})["at_rest"].value is False
    assert decode_points(profile, UNKNOWN, {"VB01": (0,)})["at_rest"].value is True
