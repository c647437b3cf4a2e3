from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.contract import CommandError
from gateway.families.profile.decode import decode_row
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.parameters import find, raw_limits, read_request, to_words
from gateway.families.profile.rows import RESERVED, Parameter
from gateway.families.profile.schema import Profile
from gateway.families.profile.word_types import to_percent
from tests.families.notation import rows, shown

WRITABLE = [
    (family, row)
    for family in FAMILIES
    for row in load_profile(family).parameters.values()
    if row.is_writable and not row.is_settable_text
]


def words(family: str, code: str, value: Any, *, model: str | None = None) -> tuple[int, ...]:
    profile = load_profile(family)
    return to_words(profile, find(profile, code), value, variant=rows(f"model={model}" if model else "")[0])


def refusal(family: str, code: str, value: Any, *, model: str | None = None) -> str:
    with pytest.raises(CommandError) as caught:
        words(family, code, value, model=model)
    return caught.value.code


@pytest.mark.parametrize(
    ("family", "code", "found", "read"),
    [
        # by its code in any case, whole, from its table
        ("ssw07", "p003", "P003", "h3*1"),
        ("ssw07", "P3", "P003", "h3*1"),
        ("ssw07", " vb08 ", "VB08", "h5008*1"),
        ("ssw07", "VB01", "VB01", "h5001*1"),
        ("ssw07", "vb01.8", "VB01.8", "c8*1"),
        ("ssw900", "c11.3.1", "C11.3.1", "h1110*2"),
        ("ssw900", "S1.1.4", "S1.1.4", "h24*2"),
        ("ssw900", "C8.6.3", "C8.6.3", "h808*8"),
        ("sst", "coil26", "COIL26", "c25*1"),
        ("sst", "r19", "R19", "i19*1"),
        ("ssw07", "P102", "P102", "h102*1"),  # any other number
        # any address has a code, the manual's where it names one
        ("ssw900", "HR1600", "HR1600", "h1600*1"),
        ("ssw900", "hr20000", "HR20000", "h20000*1"),
        ("ssw900", "COIL100", "COIL100", "c100*1"),
        ("ssw900", "DI7", "DI7", "d7*1"),
        ("ssw07", "HR5002", "HR5002", "h5002*1"),
        ("sst", "IR60", "IR60", "i60*1"),
        ("sst", "COIL27", "COIL27", "c26*1"),
        ("ssw900", "HR680", "S3.1.3.1", "h680*1"),
        ("ssw900", "HR1300", "C8.1.1.5", "h1300*1"),
    ],
)
def test_a_row_is_found_by_its_code_and_read_whole(family: str, code: str, found: str, read: str) -> None:
    profile = load_profile(family)

    assert find(profile, code).code == found
    assert shown(read_request(profile, find(profile, code))) == read


@pytest.mark.parametrize(
    ("family", "code", "why"),
    [
        *[("ssw07", code, "unknown_parameter") for code in ("P1000", "S1.1.4", "", "HR")],
        *[("sst", code, "unknown_parameter") for code in ("R43", "P1", "COIL0")],
        ("ssw900", "P003", "unknown_parameter"),
        ("ssw900", "HR65536", "unknown_parameter"),
        *[
            (family, code, f"unknown_parameter: .*Modbus function {function}, which the manual of the")
            for family, code, function in (
                ("ssw06", "DI1", "02"),
                ("ssw07", "di1", "02"),
                ("sst", "DI1", "02"),
                ("ssw900", "IR5", "04"),
                ("sst", "HR5", "03"),
            )
        ],
        *[(family, code, "not_readable") for family in ("ssw06", "ssw07") for code in ("P200", "P215")],
    ],
)
def test_what_cannot_be_asked_for_is_refused(family: str, code: str, why: str) -> None:
    with pytest.raises(CommandError, match=why):
        read_request(load_profile(family), find(load_profile(family), code))


@pytest.mark.parametrize(
    ("family", "code", "value", "sent"),
    [
        ("ssw07", "P314", 30, (30,)),
        ("ssw07", "P314", 30.0, (30,)),
        ("ssw07", "P314", "30", (30,)),
        ("ssw07", "P230", 2, (2,)),
        ("ssw07", "P230", "serial", (2,)),
        ("ssw07", "VB08", 3, (3,)),
        ("ssw06", "P313", "Fatal error", (5,)),
        ("ssw06", "VB09", 50, (8191,)),  # 5.4.6
        ("ssw06", "VB09", 25.0, (4095,)),
        ("ssw06", "P314", "off", (0,)),
        ("sst", "R40", "off", (97,)),
        ("ssw900", "C1.2", 50, (50,)),
        ("ssw900", "C2.2", 12.3, (123,)),
        ("ssw900", "C8.2.5.3", "0.5", (5,)),
        ("ssw900", "C11.3.1", -2, (0xFFFE, 0xFFFF)),
        ("ssw900", "C11.3.1", 10000, (10000, 0)),
        ("ssw900", "S5.3.2.1", 1023, (0x3FF,)),
        ("sst", "R33", 0.6, (6,)),
        ("sst", "R37", "50%", (2,)),
        ("sst", "R38", "Both", (2,)),
        ("ssw900", "C6.3.1", "2026-11-22T05:30:00", (0x1E00, 0x1605, 11, 2026)),
        ("ssw900", "C8.3.5", "192.168.1.10", (0x010A, 0xC0A8)),
        ("ssw900", "C8.3.7", "255.255.255.255", (0xFFFF, 0xFFFF)),
        ("ssw900", "C8.6.3", "Pump 1", (0x5075, 0x6D70, 0x2031, 0, 0, 0, 0, 0)),
        ("ssw900", "S5.6.2", 1, (1,)),
    ],
)
def test_values_become_the_words_that_are_sent(
    family: str, code: str, value: Any, sent: tuple[int, ...]
) -> None:
    assert words(family, code, value) == sent


@pytest.mark.parametrize(
    ("family", "code", "value", "why"),
    [
        ("ssw07", "P314", -1, "out_of_range"),
        ("ssw07", "P314", 0.5, "bad_value"),
        ("ssw07", "P314", True, "bad_value"),
        ("ssw07", "P314", None, "bad_value"),
        ("ssw07", "P314", [1], "bad_value"),
        ("ssw07", "P314", float("nan"), "bad_value"),
        ("ssw07", "P314", float("inf"), "bad_value"),
        ("ssw07", "P314", "1e999999", "bad_value"),
        ("ssw07", "P230", 4, "out_of_range"),
        ("ssw07", "VB08", 4, "out_of_range"),
        ("ssw06", "P204", 5, "not_writable"),
        ("ssw06", "VB07", 1, "not_writable"),
        ("ssw06", "P313", "No action", "bad_value"),  # 0 and 4
        ("ssw900", "C2.2", 12.34, "bad_value"),
        ("ssw900", "C4.1.2", 13, "out_of_range"),  # a reserved member
        ("ssw900", "C8.4.3", "Reserved", "out_of_range"),
        ("ssw900", "C1.4", 0, "not_writable"),
        ("sst", "R41", 0x130, "out_of_range"),  # only 30h would arrive, so the whole number is judged
        ("sst", "R40", 0, "out_of_range"),
        ("sst", "R40", 98, "out_of_range"),
        *[
            ("ssw900", "C6.3.1", value, "bad_value")
            for value in ("2026-02-30T00:00:00", "1999-01-01T00:00:00", "2026-11-22T05:30:00Z", 5)
        ],
        *[("ssw900", "C8.3.5", value, "bad_value") for value in ("192.168.1.256", "pump")],
        *[("ssw900", "C8.6.3", value, "bad_value") for value in ("", "sixteen letters!", "Pümp", "a\nb")],
        *[("ssw900", code, "1", "not_writable") for code in ("C8.6.2", "S5.9.1", "S5.6.1")],
    ],
)
def test_values_that_the_manual_does_not_allow_are_refused(
    family: str, code: str, value: Any, why: str
) -> None:
    assert refusal(family, code, value) == why


@pytest.mark.parametrize(
    ("model", "limits"),
    [
        (None, (5, 140)),
        ("SST330i-M-ES", (5, 47)),
        ("SST130i-75-M", (5, 75)),
        ("sst130i-140-m", (5, 140)),
        ("SST130i", (5, 140)),  # which of the two is not known: the widest of both
        ("SST360i", (5, 47)),  # has no column in the table
    ],
)
def test_limits_are_those_of_the_model_or_the_widest_while_it_is_unknown(
    model: str | None, limits: tuple[int, int]
) -> None:
    variant = rows(f"model={model}" if model else "")[0]

    assert raw_limits(load_profile("sst").parameters["R30"], variant) == limits


def accepted(profile: Profile, row: Parameter) -> st.SearchStrategy[int]:
    limits = raw_limits(row)
    assert limits is not None
    members = [raw for raw, label in profile.enums.get(row.enum, {}).items() if label != RESERVED]
    return st.sampled_from(members) if members else st.integers(*limits)


@given(st.data())
def test_what_is_set_is_what_is_read_back(data: st.DataObject) -> None:
    family, row = data.draw(st.sampled_from(WRITABLE), label="row")
    profile = load_profile(family)
    raw = data.draw(accepted(profile, row), label="raw")
    value = raw / 10**row.decimals if row.decimals else raw
    if row.full_scale:
        value = to_percent(raw, row.full_scale)

    sent = to_words(profile, row, value)

    assert len(sent) == row.words
    assert decode_row(profile, rows("")[0], row, sent).value == value
    assert to_words(profile, row, decode_row(profile, rows("")[0], row, sent).value) == sent
