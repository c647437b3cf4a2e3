from __future__ import annotations

import random

import pytest

from gateway.line.rtu.reply_times import (
    ENOUGH,
    FACTOR,
    MARGIN_S,
    ResponseTimeEstimator,
    ResponseTimes,
    quantile_s,
)

READ, WRITE = 3, 6
LIMIT_S = 0.1


def estimator(times_s: list[float], unit: int = 1, function: int = READ) -> ResponseTimeEstimator:
    made = ResponseTimeEstimator()
    for time_s in times_s:
        made.note_answer(unit, function, time_s)
    return made


def wait_s(made: ResponseTimeEstimator, *, least_s: float | None = 0.001, function: int = READ) -> float:
    return made.response_time_s(1, function, limit_s=LIMIT_S, least_s=least_s)


@pytest.mark.parametrize("share", [0.01, 0.5, 0.9, 0.99, 0.999])
def test_quantiles_are_right_to_five_percent(share: float) -> None:
    chance = random.Random(1)
    times_s = [chance.lognormvariate(-5, 0.5) for _ in range(3000)]
    times = ResponseTimes()
    for time_s in times_s:
        times.note(time_s)

    assert quantile_s((times,), share) == pytest.approx(sorted(times_s)[int(share * 3000) - 1], rel=0.06)


def test_of_nothing_there_is_no_quantile() -> None:
    assert quantile_s((), 0.5) is None
    assert ResponseTimeEstimator().quantiles(1) == {"p50": None, "p99": None}
    assert ResponseTimeEstimator().functions(1) == {}


def test_quantiles_are_reported_for_a_unit_and_for_each_of_its_functions() -> None:
    made = estimator([0.005] * 10)
    made.note_answer(1, WRITE, 0.02)

    assert made.quantiles(1) == pytest.approx({"p50": 0.005, "p99": 0.02})
    assert made.functions(1)[READ] == pytest.approx({"p50": 0.005, "p99": 0.005, "p999": 0.005})
    assert made.functions(1)[WRITE] == pytest.approx({"p50": 0.02, "p99": 0.02, "p999": 0.02})


def test_the_memory_is_bounded_and_follows_a_starter_that_has_changed() -> None:
    made = estimator([0.010] * 20_000)
    assert made.quantiles(1)["p99"] == pytest.approx(0.010)

    for _ in range(20_000):
        made.note_answer(1, READ, 0.002)

    assert made.quantiles(1)["p99"] == pytest.approx(0.002)


def test_an_answer_in_no_time_counts_too() -> None:
    assert estimator([0.0] * 3).quantiles(1) == {"p50": 0.0, "p99": 0.0}


def test_the_wait_tightens_to_what_a_unit_has_shown_with_a_margin() -> None:
    assert wait_s(estimator([0.005] * ENOUGH)) == pytest.approx(0.005 * FACTOR + MARGIN_S)


def test_the_wait_is_never_longer_than_the_limit_nor_shorter_than_the_least() -> None:
    assert wait_s(estimator([0.09] * ENOUGH)) == LIMIT_S
    assert wait_s(estimator([0.005] * ENOUGH), least_s=0.03) == 0.03


def test_nothing_is_concluded_without_leave_or_from_too_few_answers_or_from_another_function() -> None:
    assert wait_s(estimator([0.005] * ENOUGH), least_s=None) == LIMIT_S
    assert wait_s(estimator([0.005] * (ENOUGH - 1))) == LIMIT_S
    assert wait_s(estimator([0.005] * ENOUGH), function=WRITE) == LIMIT_S
    assert wait_s(ResponseTimeEstimator()) == LIMIT_S


def test_a_unit_that_did_not_answer_is_given_all_its_time_until_it_does() -> None:
    made = estimator([0.005] * ENOUGH)

    made.note_miss(1)
    assert wait_s(made) == LIMIT_S

    made.note_answer(1, READ, 0.005)
    assert wait_s(made) < LIMIT_S


def test_a_conclusion_is_drawn_anew_from_time_to_time() -> None:
    made = estimator([0.005] * ENOUGH)
    short_s = wait_s(made)

    for _ in range(ENOUGH):
        made.note_answer(1, READ, 0.02)

    assert wait_s(made) > short_s
