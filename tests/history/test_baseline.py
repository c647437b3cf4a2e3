"""The baseline of a motor, the drift against it, the means of months."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from gateway.contract import StartRecord, read_stored, stored
from gateway.plugins.history.baseline import FIRST, LAST, Month, Trend, TrendVerdict, month_of
from tests.contract.examples import START


def start(number: int, slower: float = 1.0, **other: Any) -> StartRecord:
    known = {
        "acceleration_s": 8.0 * slower,
        "resolution_s": 0.2,
        "i2t_a2s": 9e5 * slower,
        "peak_a": 350.0,
        "heating_pct": 10.0,
    }
    return replace(START, id=f"b-{number}", time_s=1e9 + number, **known | other)


def verdicts(trend: Trend, slower: Callable[[int], float], numbers: range) -> list[TrendVerdict]:
    return [trend.add(start(number, slower(number))) for number in numbers]


def raised_now(trend: Trend) -> bool:
    return trend.baseline is not None and trend.baseline.is_raised


def raised(found: list[TrendVerdict]) -> list[int]:
    return [index for index, verdict in enumerate(found) if verdict.raised]


def test_the_first_five_good_starts_are_the_baseline() -> None:
    trend = Trend()
    values = [8.0, 9.0, 7.5, 8.2, 30.0]

    found = [trend.add(start(n, value / 8.0)) for n, value in enumerate(values)]

    assert [verdict.is_baseline for verdict in found] == [True] * FIRST
    assert trend.baseline is not None
    assert trend.baseline.values["acceleration_s"] == pytest.approx(8.2), (
        "the median: one odd start does not count"
    )
    assert trend.baseline.typical == "b-3"
    assert not trend.add(start(5)).is_baseline


@pytest.mark.parametrize(
    "poor",
    [
        {"outcome": "tripped"},
        {"outcome": "given_up"},
        {"acceleration_s": None},
        {"resolution_s": 0.81 * 3},
    ],
)
def test_a_start_that_is_not_good_counts_nowhere(poor: dict[str, Any]) -> None:
    trend = Trend()
    verdicts(trend, lambda _: 1.0, range(FIRST))

    for number in range(100):
        assert trend.add(start(number, 3.0, **poor)) == TrendVerdict()
    assert not trend.set_baseline(start(1, **poor), client="alice")


@pytest.mark.parametrize("without", [{"i2t_a2s": 0.0, "peak_a": 0.0}, {"i2t_a2s": None, "peak_a": None}])
def test_a_motor_without_current_transformer_drifts_in_its_acceleration_time_alone(
    without: dict[str, Any],
) -> None:
    trend = Trend()
    for number in range(FIRST):
        trend.add(start(number, **without))
    assert trend.baseline is not None
    assert trend.baseline.values == {"acceleration_s": 8.0}
    restored = Trend()
    restored.restore([start(number, **without) for number in range(FIRST)], trend.baseline)

    found = [restored.add(start(number, 1.25, **without)) for number in range(FIRST, 20)]

    assert [verdict.raised for verdict in found if verdict.raised] == [
        "acceleration time grew by 25 %, 8 s to 10 s"
    ]
    assert set(found[-1].drift) == {"acceleration_s"}


def test_fifty_ever_slower_starts_raise_a_drift_once_and_say_what_grew() -> None:
    for seed in range(50):
        chance, trend = random.Random(seed), Trend()
        verdicts(trend, lambda _: chance.gauss(1.0, 0.02), range(FIRST))  # noqa: B023 - called at once

        found = verdicts(trend, lambda n: (1 + 0.01 * n) * chance.gauss(1.0, 0.02), range(50))  # noqa: B023

        assert len(raised(found)) == 1
        assert 15 <= raised(found)[0] <= 40
        assert raised_now(trend)
        text = next(verdict.raised for verdict in found if verdict.raised)
        assert text.startswith(("acceleration time grew by ", "I2t grew by "))
        assert "peak" not in text


def test_five_hundred_equal_noisy_starts_never_raise_a_drift() -> None:
    for seed in range(20):
        chance, trend = random.Random(seed), Trend()

        found = verdicts(trend, lambda _: chance.gauss(1.0, 0.05), range(500))  # noqa: B023

        assert raised(found) == []


def test_a_drift_says_in_words_what_changed_by_how_much() -> None:
    trend = Trend()
    verdicts(trend, lambda _: 1.0, range(FIRST))

    found = verdicts(trend, lambda _: 1.25, range(5, 5 + LAST + 1))

    assert found[-1].raised == (
        "acceleration time grew by 25 %, 8 s to 10 s; I2t grew by 25 %, 900000 A²s to 1125000 A²s"
    )
    assert found[-1].drift["acceleration_s"].change_pct == pytest.approx(25.0)
    assert found[-1].drift["peak_a"].change_pct == 0.0


@pytest.mark.parametrize(
    ("slower", "raises", "overs"),
    [
        (lambda n: 3.0 if 20 <= n < 24 else 1.0, 0, 0),  # four odd starts
        (lambda n: 1.3 if n >= FIRST and n % 60 < 30 else 1.0, 4, 4),  # it goes back, and comes again
        (lambda n: 1.0 if n < FIRST else 1.16 if n % 40 < 20 else 1.12, 1, 0),  # near its limit
    ],
)
def test_a_drift_is_raised_once_and_over_once_it_has_gone_back(
    slower: Callable[[int], float], raises: int, overs: int
) -> None:
    found = verdicts(Trend(), slower, range(240))

    assert (len(raised(found)), sum(verdict.is_over for verdict in found)) == (raises, overs)


def test_a_chosen_baseline_ends_a_drift_and_only_starts_from_it_on_count() -> None:
    trend = Trend()
    verdicts(trend, lambda _: 1.0, range(FIRST))
    verdicts(trend, lambda _: 1.3, range(5, 30))
    assert raised_now(trend)

    assert trend.set_baseline(start(29, 1.3), client="alice")

    assert not raised_now(trend)
    assert trend.baseline is not None
    assert (trend.baseline.client, trend.baseline.starts) == ("alice", ("b-29",))
    assert raised(verdicts(trend, lambda _: 1.3, range(30, 100))) == []
    assert len(raised(verdicts(trend, lambda _: 1.0, range(100, 130)))) == 1


@pytest.mark.parametrize("cut", [3, 5, 9, 20, 26])
def test_a_restart_changes_nothing(cut: int) -> None:
    through, first, second = Trend(), Trend(), Trend()
    everything = [start(n, 1.0 if n < 20 else 1.3) for n in range(60)]
    expected = [through.add(each) for each in everything]
    found = [first.add(each) for each in everything[:cut]]

    second.restore(everything[:cut], first.baseline)
    found += [second.add(each) for each in everything[cut:]]

    assert [verdict.raised for verdict in found] == [verdict.raised for verdict in expected]
    assert second.baseline == through.baseline


def test_a_month_has_the_means_of_its_starts_and_goes_on_after_a_restart() -> None:
    first = Month("2026-11")
    first.add(start(1, 1.0))
    first.add(start(2, 1.5, heating_pct=None))
    second = read_stored(Month, stored(first))
    second.add(start(3, 2.0, heating_pct=40.0))
    second.add(start(4, outcome="tripped", acceleration_s=None))

    month = stored(second)

    assert month["month"] == "2026-11"
    assert month["outcomes"] == {"full_voltage": 3, "tripped": 1}
    assert month["means"]["acceleration_s"] == {"count": 3, "mean": pytest.approx(12.0)}
    assert month["means"]["heating_pct"] == {"count": 2, "mean": pytest.approx(25.0)}
    assert "lowest_v" not in month["means"]


def test_a_month_is_that_of_utc() -> None:
    assert month_of(1_795_222_923.0) == "2026-11"
