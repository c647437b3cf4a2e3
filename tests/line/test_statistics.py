from __future__ import annotations

from itertools import pairwise
from typing import Any

from gateway.line.rtu.outcome import Answered
from gateway.line.scheduler.requests import Slot
from gateway.line.statistics import Statistics
from tests.line.fakes import poll

MANY = 247


def answer(statistics: Statistics, unit: int, response_time_s: float, *, now_s: float = 0.0) -> None:
    asked = poll(f"u{unit}", unit=unit)
    slot = Slot(unit, asked.request, 0.02, now_s, poll=asked)
    statistics.note(slot, Answered((1,), now_s, response_time_s), took_s=0.01, now_s=now_s)


def units(statistics: Statistics, now_s: float) -> dict[int, dict[str, Any]]:
    payload = statistics.to_dict((), worst_stop_latency_s=0.1, now_s=now_s)
    return dict(payload["units"])


def test_response_times_are_there_as_soon_as_a_unit_has_answered() -> None:
    statistics = Statistics()
    statistics.begin(0.0)

    answer(statistics, 1, 0.005)

    assert units(statistics, 1.0)[1]["response_time_s"] == {"p50": 0.005, "p99": 0.005}
    assert units(statistics, 1.0)[1]["functions"] == {3: {"p50": 0.005, "p99": 0.005, "p999": 0.005}}


def test_they_are_computed_anew_every_ten_seconds() -> None:
    statistics = Statistics()
    statistics.begin(0.0)
    answer(statistics, 1, 0.005)
    assert units(statistics, 1.0)[1]["response_time_s"]["p99"] == 0.005
    answer(statistics, 1, 0.015)

    assert units(statistics, 10.9)[1]["response_time_s"]["p99"] == 0.005
    assert units(statistics, 11.0)[1]["response_time_s"]["p99"] == 0.015


def test_of_many_units_only_some_are_computed_at_a_time_and_none_is_left_out() -> None:
    statistics = Statistics()
    statistics.begin(0.0)
    for unit in range(1, MANY + 1):
        answer(statistics, unit, 0.005)

    known = [
        sum(each["response_time_s"]["p50"] is not None for each in units(statistics, float(second)).values())
        for second in range(40)
    ]

    assert all(later - before <= 8 for before, later in pairwise(known))
    assert known[-1] == MANY


def test_the_counts_are_always_the_newest() -> None:
    statistics = Statistics()
    statistics.begin(0.0)

    for number in range(1, 4):
        answer(statistics, 1, 0.005)
        assert units(statistics, 1.0)[1]["asked"] == number
