"""Motors of one line that start at the same time: a record is less exact then, and says so."""

from __future__ import annotations

import pytest

from tests.history.cost import cost
from tests.history.simultaneous import deviations
from tests.local_host import LocalHost
from tests.virtual_time import run_virtually

NOISE_PCT = 1.0  # of a simulated reading of the current


@pytest.mark.long
@pytest.mark.parametrize(("count", "is_ours"), [(2, True), (2, False), (8, False)])
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
def test_most_of_eight_records_have_their_i2t_when_we_start_the_motors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = []
    for seed in range(6):  # the phases of the polls decide which of them are sampled often enough
        monkeypatch.setattr(LocalHost, "seed", seed)
        found += run_virtually(deviations(8, is_ours=True))

    for each in found:
        assert each.acceleration_s <= each.within_s
        assert each.peak_pct <= 2 * NOISE_PCT
        if each.i2t_pct is not None and each.i2t_within_pct is not None:
            assert each.i2t_pct <= each.i2t_within_pct + NOISE_PCT
    without = [each for each in found if each.i2t_pct is None]
    assert len(without) <= len(found) / 3


@pytest.mark.long
def test_what_is_read_for_the_history_costs_the_line_little_and_no_watchdog() -> None:
    without, with_it = (run_virtually(cost(has_history=each, long_s=400.0)) for each in (False, True))

    assert with_it.trips == without.trips == 0
    assert with_it.requests >= without.requests
    assert with_it.requests <= 1.02 * without.requests
    assert with_it.longest_gap_s <= without.longest_gap_s + 0.25
