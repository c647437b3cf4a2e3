"""Many rows in few requests."""

from __future__ import annotations

import pytest

from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.procedure import Read
from gateway.families.profile.rows import Access
from gateway.families.reading import bulk_reads, halves, is_set_by_people, is_setting, readable_codes


def count(read: Read) -> int:
    return int(read.request.count)  # type: ignore[attr-defined]  # all reads but FC43 have one


@pytest.mark.parametrize("family", FAMILIES)
def test_every_readable_row_is_read_once_and_within_the_limits(family: str) -> None:
    profile = load_profile(family)
    codes = readable_codes(profile)

    reads = bulk_reads(profile, codes)

    read = [code for each in reads for code in each.codes]
    assert sorted(read) == sorted(codes)
    assert not any(profile.parameters[code].access is Access.NONE for code in codes)
    longest = max(profile.limits.read_registers, profile.limits.read_bits)
    assert all(count(each) <= longest for each in reads)
    assert all(not each.request.is_write for each in reads)


def test_a_refused_read_is_halved_down_to_its_rows() -> None:
    profile = load_profile("ssw06")
    (read,) = bulk_reads(profile, ["P030", "P031", "P032"])

    first, second = halves(profile, read)

    assert (first.codes, second.codes) == (("P030",), ("P031", "P032"))
    assert halves(profile, first) == ()


@pytest.mark.parametrize(
    ("family", "code", "expected"),
    [
        ("ssw07", "P314", (True, True)),
        ("ssw07", "P003", (False, False)),
        ("ssw07", "VB08", (False, False)),
        ("ssw900", "C3.1", (True, True)),
        ("ssw900", "S5.3.1", (False, False)),
        ("ssw900", "S5.2.5", (False, False)),
        ("ssw900", "C8.1.1.5", (True, True)),
        ("ssw900", "C11.3.1", (True, False)),
        ("ssw900", "C6.3.1", (False, False)),
        ("sst", "R41", (True, True)),
        ("sst", "COIL1", (False, False)),
    ],
)
def test_settings_are_distinguished_from_readings_outputs_and_commands(
    family: str, code: str, expected: tuple[bool, bool]
) -> None:
    profile = load_profile(family)
    row = profile.parameters[code]

    assert (is_setting(profile, row), is_set_by_people(profile, row)) == expected
