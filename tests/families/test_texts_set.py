"""Dates and names that are set in the byte order that the starter has; their words: test_parameters.py."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.families.command.settings import build_set
from gateway.families.profile.load import load_profile
from gateway.families.profile.word_types import from_text
from tests.families.notation import prepared, rows, shown

SSW900 = load_profile("ssw900")
CLOCK = (0x1E00, 0x1605, 11, 2026)  # 2026-11-22T05:30:00


def swapped(words: tuple[int, ...]) -> tuple[int, ...]:
    return tuple((word & 0xFF) << 8 | word >> 8 for word in words)


def built(code: str, value: Any, seen: tuple[int, ...]) -> Any:
    args = {"parameter": code, "value": value}
    return build_set(SSW900, rows("")[0], args, seen={code: seen})


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
