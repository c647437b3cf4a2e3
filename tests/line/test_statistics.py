from __future__ import annotations

import random

import pytest

from gateway.line.rtu.outcome import Answered
from gateway.line.scheduler.requests import Slot
from gateway.line.statistics import ResponseTimes, Statistics, quantile_s
from tests.line.fakes import poll


def test_shares_are_of_the_last_half_minute_and_the_silences_are_what_is_left_of_the_busy_time() -> None:
    statistics = Statistics(lambda polls: 0.0)
    statistics.begin(0.0)
    asked = poll("status", unit=1)
    for second in range(1, 11):
        slot = Slot(1, asked.request, 0.02, float(second), poll=asked)
        statistics.note(
            slot,
            Answered((1,), second, 0.05),
            took_s=0.2,
            now_s=float(second),
            request_s=0.03,
            since_request_s=0.13,
            reply_s=0.08,
        )

    share = statistics.time_share(10.0)

    assert share == pytest.approx({"requests": 0.03, "delays": 0.05, "replies": 0.08, "silences": 0.04})
    assert sum(share.values()) == pytest.approx(statistics.utilisation(10.0))


@pytest.mark.parametrize("share", [0.01, 0.5, 0.9, 0.99, 0.999])
def test_quantiles_are_right_to_five_percent(share: float) -> None:
    chance = random.Random(1)
    times_s = [chance.lognormvariate(-5, 0.5) for _ in range(3000)]
    times = ResponseTimes()
    for time_s in times_s:
        times.note(time_s)

    assert quantile_s((times,), share) == pytest.approx(sorted(times_s)[int(share * 3000) - 1], rel=0.06)
