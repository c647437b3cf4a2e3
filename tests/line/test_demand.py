from __future__ import annotations

from math import inf

import pytest

from gateway.line.capacity.demand import Demand


def test_a_request_waits_for_all_whose_deadline_is_not_later() -> None:
    demand = Demand([(0.1, 1.0), (0.2, 1.0), (0.3, 10.0)])

    assert demand.load == pytest.approx(0.33)
    assert demand.response_s(1.0) == pytest.approx(0.3)
    assert demand.response_s(10.0) == pytest.approx(0.3 * 10 + 0.3)


def test_a_request_can_wait_for_one_of_a_longer_period_that_came_before() -> None:
    demand = Demand([(0.5, 1.0), (0.4, 1.2)])

    assert demand.response_s(1.0) == pytest.approx(
        0.7
    )  # the other came 0.2 s before: 0.9 s until both are due


def test_what_does_not_fit_waits_for_ever() -> None:
    demand = Demand([(1.1, 1.0)])

    assert demand.response_s(1.0) == inf


def test_far_beyond_what_is_looked_at_the_load_bounds_the_demand() -> None:
    demand = Demand([(0.0001, 0.001), (1.0, 1000.0)])

    assert demand.response_s(1000.0) == pytest.approx(1000.0 * demand.load)
