"""Motors of one line that start at the same time: a record is less exact then, and says so."""

from __future__ import annotations

import pytest

from tests.history.cost import cost
from tests.history.simultaneous import deviations
from tests.virtual_time import run_virtually

NOISE_PCT = 1.0  # of a simulated reading of the current


@pytest.mark.long
@pytest.mark.parametrize("is_ours", [True, False])
@pytest.mark.parametrize("count", [2, 8])
def test_each_record_is_as_exact_as_it_says(count: int, *, is_ours: bool) -> None:
    found = run_virtually(deviations(count, is_ours=is_ours))

    assert len(found) == count
    for each in found:
        assert each.acceleration_s <= each.within_s
        assert each.peak_pct <= 2 * NOISE_PCT
        assert each.i2t_pct is not None
        assert each.i2t_within_pct is not None
        assert each.i2t_pct <= each.i2t_within_pct + NOISE_PCT


@pytest.mark.long
def test_what_is_read_for_the_history_costs_the_line_little_and_no_watchdog() -> None:
    without, with_it = (run_virtually(cost(has_history=each, long_s=400.0)) for each in (False, True))

    assert with_it.trips == without.trips == 0
    assert with_it.requests >= without.requests
    assert with_it.requests <= 1.02 * without.requests
    assert with_it.longest_gap_s <= without.longest_gap_s + 0.25
