from __future__ import annotations

from math import inf

import pytest

from gateway.line.demand import Demand


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


def test_no_request_waits_longer_than_the_longest_jam() -> None:
    demand = Demand([(0.1, 1.0), (0.3, 10.0)])

    assert demand.busy_s(0.05) == pytest.approx(0.45)
    assert Demand([(0.6, 1.0), (0.5, 10.0)]).busy_s(0.0) == pytest.approx(0.6 * 2 + 0.5)


def test_when_all_is_asked_for_at_once_each_counts_once_or_as_often_as_it_comes() -> None:
    demand = Demand([(0.1, 1.0), (0.3, 10.0)])

    assert demand.storm_s(1.0) == pytest.approx(0.4)
    assert demand.storm_s(10.0) == pytest.approx(1.3)


def test_what_does_not_fit_waits_for_ever() -> None:
    demand = Demand([(1.1, 1.0)])

    assert demand.response_s(1.0) == inf
    assert demand.busy_s(0.0) == inf


def test_far_beyond_what_is_looked_at_the_load_bounds_the_demand() -> None:
    demand = Demand([(0.0001, 0.001), (1.0, 1000.0)])

    assert demand.response_s(1000.0) == pytest.approx(1000.0 * demand.load)


def test_a_jam_that_hardly_ends_is_bounded_too() -> None:
    demand = Demand([(0.9999, 1.0), (5.0, 1e6)])

    assert demand.busy_s(0.0) == pytest.approx(5.9999 / (1.0 - demand.load))


def test_nothing_asks_for_nothing() -> None:
    assert (Demand([]).load, Demand([]).busy_s(0.2)) == (0.0, 0.2)
