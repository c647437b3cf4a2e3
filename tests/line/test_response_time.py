from __future__ import annotations

import random

import pytest

from gateway.line.rtu.reply_times import ResponseTimes, UnitResponseTimes, quantile_s

READ, WRITE = 3, 6


def response_times(times_s: list[float], unit: int = 1, function: int = READ) -> UnitResponseTimes:
    made = UnitResponseTimes()
    for time_s in times_s:
        made.note_answer(unit, function, time_s)
    return made


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
    assert UnitResponseTimes().quantiles(1) == {"p50": None, "p99": None}
    assert UnitResponseTimes().functions(1) == {}
