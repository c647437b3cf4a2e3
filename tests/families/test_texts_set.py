"""Dates, addresses and names that are set: their words, in the byte order that the starter has."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.contract import CommandError
from gateway.families.command.settings import build_set
from gateway.families.profile.load import load_profile
from gateway.families.profile.parameters import to_words
from gateway.families.profile.word_types import from_text, to_text
from tests.families.notation import prepared, rows, shown

SSW900 = load_profile("ssw900")
CLOCK = (0x1E00, 0x1605, 11, 2026)  # 2026-11-22T05:30:00


def swapped(words: tuple[int, ...]) -> tuple[int, ...]:
    return tuple((word & 0xFF) << 8 | word >> 8 for word in words)


def built(code: str, value: Any, seen: tuple[int, ...]) -> Any:
    args = {"parameter": code, "value": value}
    return build_set(SSW900, rows("")[0], args, seen={code: seen})


@pytest.mark.parametrize(
    ("code", "value", "words"),
    [
        ("C6.3.1", "2026-11-22T05:30:00", CLOCK),
        ("C8.3.5", "192.168.1.10", (0x010A, 0xC0A8)),
        ("C8.3.7", "255.255.255.255", (0xFFFF, 0xFFFF)),
        ("C8.6.3", "Pump 1", (0x5075, 0x6D70, 0x2031, 0, 0, 0, 0, 0)),
        ("S5.6.2", 1, (1,)),
    ],
)
def test_what_the_manual_prints_can_be_set(code: str, value: Any, words: tuple[int, ...]) -> None:
    row = SSW900.parameters[code]

    assert to_words(SSW900, row, value) == words
    if isinstance(value, str):
        assert to_text(row.type, words) == value


@pytest.mark.parametrize(
    ("code", "value"),
    [
        ("C6.3.1", "2026-02-30T00:00:00"),
        ("C6.3.1", "1999-01-01T00:00:00"),
        ("C6.3.1", "2026-11-22T05:30:00Z"),
        ("C6.3.1", 5),
        ("C8.3.5", "192.168.1.256"),
        ("C8.3.5", "pump"),
        ("C8.6.3", ""),
        ("C8.6.3", "sixteen letters!"),
        ("C8.6.3", "Pümp"),
        ("C8.6.3", "a\nb"),
        *[(code, "1") for code in ("C8.6.2", "S5.9.1", "S5.6.1")],  # a PIN, and what can only be read
    ],
)
def test_what_it_does_not_print_is_refused(code: str, value: Any) -> None:
    with pytest.raises(CommandError) as error:
        to_words(SSW900, SSW900.parameters[code], value)

    assert error.value.code == ("not_writable" if value == "1" else "bad_value")


@pytest.mark.parametrize("is_swapped", [False, True])
def test_the_bytes_lie_as_they_were_read(*, is_swapped: bool) -> None:
    old = from_text(SSW900.parameters["C8.6.3"].type, "Fan", words=8, longest=15) or ()
    new = (0x5075, 0x6D70, 0, 0, 0, 0, 0, 0)
    seen = swapped(old) if is_swapped else old

    procedure = built("C8.6.3", "Pump", seen)

    (step,) = procedure.steps
    words = swapped(new) if is_swapped else new
    assert shown(step.request) == "808:" + ",".join(f"{word:04X}" for word in words)


@pytest.mark.parametrize("is_swapped", [False, True])
def test_a_clock_that_was_set_is_read_back_as_it_goes_on(*, is_swapped: bool) -> None:
    seen = swapped(CLOCK) if is_swapped else CLOCK
    procedure = built("C6.3.1", "2026-12-31T23:59:58", seen)
    (step,) = procedure.steps
    later = (0x0000, 0x0100, 1, 2027)

    assert procedure.verify.is_met({"C6.3.1": step.request.words})
    assert procedure.verify.is_met({"C6.3.1": swapped(later) if is_swapped else later})
    assert not procedure.verify.is_met({"C6.3.1": seen})


def test_an_aborted_start_up_is_seen_by_the_status_and_wants_standstill() -> None:
    procedure = built("S5.6.2", 1, (0,))

    assert prepared("ssw900", "set S5.6.2=1").requires == ("is_stopped",)
    assert [shown(step.request) for step in procedure.steps] == ["693:0001"]
    assert procedure.verify.is_met({"S5.6.1": (0x0001,)})
    assert not procedure.verify.is_met({"S5.6.1": (0x0004,)})
    assert procedure.wears == 0
