"""Motors of one line that start at the same time: a record is less exact then, and says so."""

from __future__ import annotations

import pytest

from tests.history.simultaneous import deviations
from tests.virtual_time import run_virtually

NOISE_PCT = 1.0  # of a simulated reading of the current


@pytest.mark.long
@pytest.mark.parametrize("is_ours", [True, False])
def test_each_of_eight_records_is_as_exact_as_it_says_and_most_have_their_i2t(*, is_ours: bool) -> None:
    found = run_virtually(deviations(8, is_ours=is_ours))

    assert len(found) == 8
    for each in found:
        assert each.acceleration_s <= each.within_s
        assert each.peak_pct <= 2 * NOISE_PCT
        if each.i2t_pct is not None and each.i2t_within_pct is not None:
            assert each.i2t_pct <= each.i2t_within_pct + NOISE_PCT
    assert [each.i2t_pct for each in found].count(None) <= 4
