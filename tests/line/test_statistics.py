from __future__ import annotations

import pytest

from gateway.line.rtu.outcome import Answered
from gateway.line.scheduler.requests import Slot
from gateway.line.statistics import Statistics, quantile
from tests.line.fakes import poll


def test_the_utilisation_is_that_of_the_last_half_minute() -> None:
    statistics = Statistics()
    statistics.begin(0.0)
    asked = poll("status", unit=1)
    for second in range(1, 41):
        slot = Slot(1, asked.request, 0.02, float(second), poll=asked)
        took_s = 0.9 if second <= 10 else 0.2
        statistics.note(slot, Answered((1,), second, 0.05), took_s=took_s, now_s=float(second))

    assert statistics.utilisation(40.0) == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("count", "share", "expected"),
    [(0, 0.5, None), (1, 0.99, 1), (2, 0.5, 1), (99, 0.99, 99), (100, 0.99, 99)],
)
def test_a_quantile_is_the_least_number_up_to_which_the_share_lies(
    count: int, share: float, expected: int | None
) -> None:
    assert quantile(range(1, count + 1), share) == expected
