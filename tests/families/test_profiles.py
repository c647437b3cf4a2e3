"""What the shipped profiles say, checked against numbers of the manuals that stand here in their own form."""

from __future__ import annotations

import pytest

from gateway.contract import CommandError
from gateway.families.profile.decode import is_there
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.parameters import factory_settings, to_words
from gateway.families.profile.rows import Access, Confidence, Table
from gateway.families.profile.schema import Variant


def test_the_ssw900_has_every_row_member_bit_and_message_of_its_manual() -> None:
    profile = load_profile("ssw900")

    assert (len(profile.parameters), len(profile.alarms)) == (501, 77)
    assert sum(len(profile.enums[row.enum]) for row in profile.parameters.values() if row.enum) == 673
    assert sum(len(bits) for bits in profile.bits.values()) == 240


@pytest.mark.parametrize(
    ("family", "named", "members", "bits"), [("ssw06", 39, 36, 80), ("ssw07", 18, 30, 48)]
)
def test_the_ssw06_and_ssw07_have_what_their_serial_manuals_name(
    family: str, named: int, members: int, bits: int
) -> None:
    profile = load_profile(family)
    sure = {row.code for row in profile.parameters.values() if row.confidence is Confidence.MANUAL}

    # P001 and P101 are only addresses in the SSW-07's manual; their meaning comes from another document
    from_elsewhere = {"P001", "P101"} if family == "ssw07" else set()
    assert len({code for code in sure if code.startswith("P")} | from_elsewhere) == named
    members_of = [profile.enums[code] for code in sure & set(profile.enums) if code.startswith("P")]
    assert sum(map(len, members_of)) == members
    assert sum(len(labels) for labels in profile.bits.values()) == bits


def test_the_sst_has_43_registers_and_26_coils_with_addresses_one_below_their_numbers() -> None:
    profile = load_profile("sst")

    registers = [row for row in profile.parameters.values() if row.table is Table.INPUT]
    coils = [row for row in profile.parameters.values() if row.table is Table.COIL]
    assert [row.address for row in registers] == list(range(43))
    assert [row.code for row in coils] == [f"COIL{row.address + 1}" for row in coils]
    assert len(coils) == 26


@pytest.mark.parametrize("family", FAMILIES)
def test_only_rows_that_are_legible_allowed_and_bounded_are_writable(family: str) -> None:
    profile = load_profile(family)

    for row in profile.parameters.values():
        if row.is_writable:
            assert row.access is Access.RW
            assert row.confidence in (Confidence.MANUAL, Confidence.REPAIRED)
            assert row.raw_min is not None or row.is_settable_text
        else:
            with pytest.raises(CommandError) as refusal:
                to_words(profile, row, row.raw_min or 0)
            assert refusal.value.code == "not_writable"


WRITABLE = {  # those whose range is printed
    "ssw07": {"P220", "P229", "P230", "P308", "P312", "P313", "P314", "VB08"},
    "ssw06": {"P220", "P229", "P230", "P308", "P312", "P313", "P314", "VB08", "VB09", "VB10"},
    "sst": {f"R{number}" for number in (4, 5, 6, *range(30, 43))},
}
COMMANDS = {  # what moves or stops the motor
    "ssw06": {"VB03", "VB07", *(f"VB03.{bit}" for bit in range(8))},
    "ssw07": {"VB03", *(f"VB03.{bit}" for bit in range(8))},
    "ssw900": {"S5.2.5", "S5.2.6"},
    "sst": {"COIL1", "COIL2", "COIL3", "COIL4"},
}
TIMING = {  # s to a reading, to a write, to one for each register, of a restart; the manuals' or ours
    "ssw06": (0.010, 0.010, 0.010, 10.0, True),
    "ssw07": (0.020, 0.020, 0.020, 0.0, True),
    "ssw900": (0.100, 0.100, 0.0, 0.0, False),
    "sst": (0.100, 0.100, 0.0, 10.0, False),
}
FACTORY = {
    "ssw06": {"P220": 2, "P229": 0, "P230": 0, "P308": 1, "P312": 1, "P313": 0, "P314": 0},  # 2.1-2.7
    "ssw07": {"P220": 3, "P229": 0, "P230": 1, "P308": 1, "P312": 1, "P313": 1, "P314": 0},
    "ssw900": {"C8.2.1": 2, "C8.2.4": 1, "C8.2.5.2": 3, "C8.1.1.3": 26, "C8.1.2.3": 11, "C8.1.2.25": 0},
    "sst": {},
}


@pytest.mark.parametrize("family", FAMILIES)
def test_rows_times_and_factory_settings_are_those_that_the_manual_prints(family: str) -> None:
    profile = load_profile(family)
    timing, factory = profile.timing, factory_settings(profile)
    writable = {row.code for row in profile.parameters.values() if row.is_writable}

    assert WRITABLE.get(family, writable) == writable
    assert {row.code for row in profile.parameters.values() if row.access is Access.COMMAND} == COMMANDS[
        family
    ]
    times = timing.read_s, timing.write_s, timing.write_per_register_s, timing.restart_s, timing.is_stated
    assert times == TIMING[family]
    assert FACTORY[family].items() <= {code: words[0] for code, words in factory.items()}.items()
    for code, words in factory.items():
        row = profile.parameters[code]
        assert (row.raw_min or 0) <= words[0] <= (row.raw_max or 0)


def test_the_ssw07_has_no_alarm_bit_and_some_bits_only_from_newer_firmware() -> None:
    points = load_profile("ssw07").points

    assert "alarm" not in points
    late = {
        name
        for name, point in points.items()
        if not is_there(load_profile("ssw07"), Variant(firmware="1.3"), point.source)
    }
    assert late == {"jog", "braking", "reversing", "reverse"}
