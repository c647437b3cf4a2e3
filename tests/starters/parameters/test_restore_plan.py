"""What a restore would change."""

from __future__ import annotations

import pytest

from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.starters.parameters.model import ParameterEntry, ParameterSet
from gateway.starters.parameters.restore_plan import RestorePlan, plan_restore, restore_codes

Rows = dict[str, tuple[int, ...]]


def plan(
    family: str, wanted: dict[str, ParameterEntry], seen: Rows, *, with_sources: bool = False
) -> RestorePlan:
    return plan_restore(
        load_profile(family),
        Variant(),
        wanted=ParameterSet("p", family, parameters=wanted),
        seen=seen,
        with_sources=with_sources,
    )


def codes(found: RestorePlan) -> list[str]:
    return [change.code for change in found.changes]


@pytest.mark.parametrize(
    ("family", "code", "entry", "row"),
    [
        ("ssw07", "P003", ParameterEntry(raw=(9,)), 1),  # a reading
        ("ssw07", "VB03", ParameterEntry(raw=(9,)), 1),  # a command
        ("ssw07", "X1", ParameterEntry(raw=(9,)), 1),  # no manual names it
        ("ssw07", "P277", ParameterEntry(value=9, raw=(9,)), 9),  # never to be set, but equal
        ("ssw900", "C8.2.5.1", ParameterEntry(value="Inactive"), 0),
        ("sst", "R41", ParameterEntry(raw=(0x0105,)), 5),  # only the low byte counts
    ],
)
def test_what_needs_no_change_is_passed_over(family: str, code: str, entry: ParameterEntry, row: int) -> None:
    assert plan(family, {code: entry}, {code: (row,)}) == RestorePlan((), {})


def test_readings_commands_and_unknown_codes_are_not_even_read() -> None:
    wanted = {code: ParameterEntry(raw=(9,)) for code in ("P003", "VB03", "VB08", "X1")}

    assert restore_codes(load_profile("ssw07"), ParameterSet("p", "ssw07", parameters=wanted)) == ()


@pytest.mark.parametrize(
    ("family", "code", "entry", "reason"),
    [
        ("ssw07", "P308", ParameterEntry(raw=(9,)), "cut the connection"),
        ("ssw07", "P277", ParameterEntry(raw=(9,)), "cannot be set"),
        ("ssw07", "P313", ParameterEntry(raw=(9,)), "takes one of 0 (No action)"),
        ("ssw07", "P313", ParameterEntry(raw=(1, 1)), "1 words, the file gives 2"),
        ("ssw07", "P313", ParameterEntry(value="Coffee"), "takes one of 0 (No action)"),
        ("ssw07", "P314", ParameterEntry(value=20, raw=(30,)), "disagree"),
        ("ssw900", "C1.4", ParameterEntry(raw=(1,)), "not legible"),
    ],
)
def test_what_cannot_be_written_is_left_with_the_reason(
    family: str, code: str, entry: ParameterEntry, reason: str
) -> None:
    found = plan(family, {code: entry}, {code: (2,)})

    assert found.changes == ()
    assert reason in found.left[code]


def test_what_the_starter_does_not_give_is_left() -> None:
    assert plan("ssw07", {"P314": ParameterEntry(raw=(3,))}, {}).left == {
        "P314": "the starter does not give it"
    }


def test_who_commands_the_motor_is_changed_last_and_only_when_asked() -> None:
    wanted = {"P230": ParameterEntry(raw=(2,)), "P314": ParameterEntry(raw=(3,))}
    seen: Rows = {"P230": (1,), "P314": (0,)}

    without, with_sources = plan("ssw07", wanted, seen), plan("ssw07", wanted, seen, with_sources=True)

    assert codes(without) == ["P314"]
    assert "who commands the motor" in without.left["P230"]
    assert codes(with_sources) == ["P314", "P230"]


@pytest.mark.parametrize(
    ("mode", "tenths", "order"), [(1, 15, ["C8.2.5.3", "C8.2.5.1"]), (0, 0, ["C8.2.5.1", "C8.2.5.3"])]
)
def test_the_timeout_is_never_active_at_zero_on_the_way(mode: int, tenths: int, order: list[str]) -> None:
    wanted = {"C8.2.5.1": ParameterEntry(raw=(mode,)), "C8.2.5.3": ParameterEntry(raw=(tenths,))}
    seen: Rows = {"C8.2.5.1": (1 - mode,), "C8.2.5.3": (15 - tenths,)}

    assert codes(plan("ssw900", wanted, seen)) == order
