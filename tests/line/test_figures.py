from __future__ import annotations

from itertools import pairwise
from typing import Any

from gateway.line.rtu.outcome import Answered
from gateway.line.scheduler.requests import Slot
from gateway.line.statistics import Statistics
from tests.line.fakes import poll

MANY = 247


def answer(figures: Statistics, unit: int, response_time_s: float, *, now_s: float = 0.0) -> None:
    asked = poll(f"u{unit}", unit=unit)
    turn = Slot(unit, asked.request, 0.02, now_s, poll=asked)
    figures.note(turn, Answered((1,), now_s, response_time_s), took_s=0.01, now_s=now_s)


def units(figures: Statistics, now_s: float) -> dict[int, dict[str, Any]]:
    told: dict[int, dict[str, Any]] = figures.to_dict((), worst_stop_latency_s=0.1, now_s=now_s)["units"]
    return told


def test_response_times_are_there_as_soon_as_a_unit_has_answered() -> None:
    figures = Statistics()
    figures.begin(0.0)

    answer(figures, 1, 0.005)

    assert units(figures, 1.0)[1]["response_time_s"] == {"p50": 0.005, "p99": 0.005}
    assert units(figures, 1.0)[1]["functions"] == {3: {"p50": 0.005, "p99": 0.005, "p999": 0.005}}


def test_they_are_reckoned_anew_every_ten_seconds() -> None:
    figures = Statistics()
    figures.begin(0.0)
    answer(figures, 1, 0.005)
    assert units(figures, 1.0)[1]["response_time_s"]["p99"] == 0.005
    answer(figures, 1, 0.015)

    assert units(figures, 10.9)[1]["response_time_s"]["p99"] == 0.005
    assert units(figures, 11.0)[1]["response_time_s"]["p99"] == 0.015


def test_of_many_units_only_some_are_reckoned_at_a_time_and_all_have_their_turn() -> None:
    figures = Statistics()
    figures.begin(0.0)
    for unit in range(1, MANY + 1):
        answer(figures, unit, 0.005)

    known = [
        sum(each["response_time_s"]["p50"] is not None for each in units(figures, float(second)).values())
        for second in range(40)
    ]

    assert all(later - before <= 8 for before, later in pairwise(known))
    assert known[-1] == MANY


def test_the_counts_are_always_the_newest() -> None:
    figures = Statistics()
    figures.begin(0.0)

    for number in range(1, 4):
        answer(figures, 1, 0.005)
        assert units(figures, 1.0)[1]["asked"] == number
