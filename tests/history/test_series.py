"""Values over time: what a step shows, and what is stored of an hour."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.contract import Quality, RecordWriter, ValueRecord
from gateway.plugins.history.series import FINE_S, NAN, AllSeries, Sample, Steps, gathered
from gateway.system.clock import SystemClock
from tests.virtual_time import HandClock


def shown(steps: Steps, now_s: float) -> list[tuple[float, float, float]]:
    """Return the steps as they are, with -1 for what is not known."""
    return [
        tuple(-1.0 if math.isnan(value) else value for value in each[1:])  # type: ignore[misc]
        for each in steps.samples(now_s)
    ]


@pytest.mark.parametrize(
    ("puts", "now_s", "expected"),
    [
        ([], 5.0, [(-1, -1, -1)] * 4),
        ([(7.0, 0.0), (3.0, 5.0)], 7.0, [(7, 7, 7), (7, 7, 7), (3, 7, 3), (3, 3, 3)]),  # it holds
        ([(5.0, 0.0), (NAN, 2.0), (6.0, 6.0)], 6.5, [(5, 5, 5), (5, 5, -1), (-1, -1, -1), (6, 6, 6)]),
        ([(1.0, 6.0), (480.0, 6.5), (12.0, 7.0)], 7.5, [(-1, -1, -1)] * 3 + [(1, 480, 12)]),
        ([(2.0, 0.0)], 1_000_000.0, [(2, 2, 2)] * 4),  # a pause longer than what is remembered
    ],
)
def test_a_step_has_the_least_the_most_and_the_last_value(
    puts: Iterable[tuple[float, float]], now_s: float, expected: list[tuple[float, float, float]]
) -> None:
    steps = Steps(FINE_S, 4)

    for value, at_s in puts:
        steps.put(value, at_s)

    assert shown(steps, now_s) == expected


def test_longer_steps_have_the_extremes_of_those_in_them_and_what_lies_outside_is_left_out() -> None:
    samples = [Sample(at_s, at_s - 1, at_s + 1, at_s) for at_s in (-1.0, 0.5, 1.5, 2.5, 3.5, 9.0)]
    samples.insert(4, Sample(3.2, NAN, NAN, NAN))

    series = gathered(samples, begin_s=0.0, step_s=2.0, steps=3)

    assert series == ([-0.5, 1.5, None], [2.5, 4.5, None], [1.5, 3.5, None])


def test_what_no_page_shows_and_nothing_stores_is_not_held() -> None:
    nothing: Any = None
    series = AllSeries(RecordWriter(SystemClock(), print), nothing, (), has_page=False)
    value = ValueRecord(
        starter="pump", point="current", value=12.0, unit="A", quality=Quality.GOOD, time_s=0.0, seq=1
    )

    known = []
    for has_page in (False, True, False):
        series.reconfigure(["pump"], (), has_page=has_page)
        series.put(value)
        known.append(series.points("pump"))

    assert known == [[], ["current"], []]


def test_a_point_that_a_reload_takes_out_and_another_brings_back_keeps_its_stored_hour() -> None:
    clock, rows, value = HandClock(), dict[str, Any](), partial(ValueRecord, starter="pump", unit="A", seq=1)
    store: Any = SimpleNamespace(put=lambda row: rows.update({row.id: row.data["points"]}))
    series = AllSeries(RecordWriter(clock, print), store, ["current", "p002"], has_page=False)

    for minute, points in enumerate((["current", "p002"], ["current"], ["current", "p002"])):
        clock.s = minute * 60.0
        series.reconfigure(["pump"], points, has_page=False)
        for point in points:
            series.put(value(point=point, value=minute + 1.0, quality=Quality.GOOD, time_s=0.0))
        series.write()

    assert [hour["p002"][2] for hour in rows.values()] == [[1.0, None, 3.0]]
