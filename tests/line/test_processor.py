"""How much of a processor lines take, computed."""

from __future__ import annotations

import pytest

from gateway.line.capacity.forecast import forecast
from gateway.line.capacity.processor import (
    BASE_SHARE,
    FULL_TIMING,
    HELD_SHARE,
    LineDemand,
    demand_of,
    full_line,
    full_lines_held,
    processor_share,
)
from gateway.line.scheduler.requests import Poll
from gateway.modbus.reads import ReadHoldingRegisters


def polls(count: int, every_s: float) -> list[Poll]:
    return [Poll(f"u{unit}", unit, ReadHoldingRegisters(0, 2), every_s, 0.02) for unit in range(1, count + 1)]


def demand(count: int, every_s: float) -> LineDemand:
    return demand_of(forecast(polls(count, every_s), FULL_TIMING), FULL_TIMING, starters=count)


def test_a_line_with_time_to_spare_asks_for_its_periods() -> None:
    assert demand(8, 1.0) == LineDemand(pytest.approx(8.0), 8)


@pytest.mark.parametrize("every_s", [0.0, 0.05])
def test_a_line_that_is_always_full_asks_for_what_starters_that_answer_quickly_let_through(
    every_s: float,
) -> None:
    found = demand(8, every_s)

    assert found.per_s == pytest.approx(full_line().per_s, rel=0.01)
    assert 55 < found.per_s < 65  # a request takes some 17 ms


def test_a_line_without_starters_asks_for_nothing() -> None:
    assert demand(0, 1.0) == LineDemand(0.0, 0)
    assert processor_share([demand(0, 1.0)], slowness=2.0) == 2 * BASE_SHARE


def test_the_share_follows_from_transactions_starters_and_slowness() -> None:
    one = processor_share([full_line()], slowness=1.0)

    assert 0.07 < one < 0.09
    assert processor_share([full_line()], slowness=5.0) == pytest.approx(5 * one)
    assert one < processor_share([full_line()] * 2, slowness=1.0) < 2 * one
    few = LineDemand(full_line().per_s, 1)
    assert processor_share([few], slowness=1.0) < one  # starters cost something, too


@pytest.mark.parametrize("slowness", [0.7, 1.0, 2.0, 5.0, 8.0])
def test_a_machine_holds_as_many_full_lines_as_fit_into_its_share(slowness: float) -> None:
    held = full_lines_held(slowness=slowness)

    assert processor_share([full_line()] * held, slowness=slowness) <= HELD_SHARE
    assert processor_share([full_line()] * (held + 1), slowness=slowness) > HELD_SHARE


MEASURED = [  # with a fifth of a processor, docs/performance.md: lines, starters, transactions/s, share used
    (1, 8, 57.6, 0.35),
    (1, 32, 52.8, 0.49),
    (1, 32, 54.4, 0.39),
    (2, 32, 110.7, 0.55),
    (3, 32, 154.7, 0.75),
    (4, 32, 197.0, 0.85),
]


@pytest.mark.parametrize(("lines", "starters", "per_s", "used"), MEASURED)
def test_what_was_measured_with_a_fifth_of_a_processor_is_computed_to_a_quarter(
    lines: int, starters: int, per_s: float, used: float
) -> None:
    assert processor_share([LineDemand(per_s / lines, starters)] * lines, slowness=5.0) == pytest.approx(
        used, rel=0.25
    )


def test_a_machine_that_is_slow_enough_holds_no_line_and_none_holds_an_endless_number() -> None:
    assert full_lines_held(slowness=50.0) == 0
    assert full_lines_held(slowness=0.0) == 247
