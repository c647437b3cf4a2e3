"""What is computed of a line: who waits how long for whom, and what a failure costs; and its statistics."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest

from gateway.families.diagnosis import decision_reads
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.schema import Variant
from gateway.line.capacity.demand import Demand
from gateway.line.capacity.line_forecast import forecast
from gateway.line.capacity.outage import WIDE_FACTOR, Restart, first_requests_s, gaps_of
from gateway.line.rtu.transaction import Answered, longest_s
from gateway.line.scheduler.requests import Slot
from gateway.line.statistics import Statistics, quantile
from gateway.starters import StarterSetup, polls_of
from tests.line.ideal_line import IdealLine, cost_s
from tests.line.line_rig import TIMING, poll

MANAGER = Restart(restart_s=0.5, watchdog_s=8.0, abort_s=2.0, start_up_s=1.0)


@pytest.mark.parametrize(
    ("requests", "limit_s", "response_s"),
    [  # time on the line and deadline of each
        ([(0.1, 1.0), (0.2, 1.0), (0.3, 10.0)], 1.0, 0.3),  # it waits for all whose deadline is not later
        ([(0.1, 1.0), (0.2, 1.0), (0.3, 10.0)], 10.0, 0.3 * 10 + 0.3),
        ([(0.5, 1.0), (0.4, 1.2)], 1.0, 0.7),  # the other came 0.2 s before: 0.9 s until both are due
        ([(1.1, 1.0)], 1.0, inf),
        ([(0.0001, 0.001), (1.0, 1000.0)], 1000.0, 1000.0 * 0.101),  # far beyond what is looked at: the load
    ],
)
def test_a_request_waits_for_those_whose_deadlines_come_first(
    requests: list[tuple[float, float]], limit_s: float, response_s: float
) -> None:
    assert Demand(requests).response_s(limit_s) == pytest.approx(response_s)


def test_all_periods_of_an_over_full_line_are_stretched_by_one_factor() -> None:
    polls = [*(poll(f"p{number}", number, 0.1) for number in range(1, 11)), poll("p11", 11, 3.0)]
    line = IdealLine(polls, lambda slot: cost_s(slot.poll, TIMING) if slot.poll else 0.0)
    line.run(15.0)
    line.gaps_s.clear()
    line.run(60.0)

    prospect = forecast(polls, TIMING)

    assert prospect.is_overloaded
    assert prospect.factor == pytest.approx(prospect.load)
    for each in polls:
        seen = line.gaps_s[each.key]
        assert sum(seen) / len(seen) == pytest.approx(prospect.factor * each.every_s, rel=0.05)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_stop_waits_no_longer_for_what_commands_read_than_is_forecast(family: str) -> None:
    setup = StarterSetup("x", "x", 1, load_profile(family), Variant(), TIMING)

    prospect = forecast(polls_of(setup), TIMING)

    for read in decision_reads(setup.profile):
        taken_s = longest_s(read, TIMING, response_time_s=setup.response_time_of(read))
        assert taken_s + TIMING.silence_s <= prospect.stop_latency_s


def test_watchdogs_that_need_more_than_the_line_has_are_not_met() -> None:
    polls = [replace(poll(f"p{number}", number), deadline_s=0.2) for number in range(1, 11)]

    prospect = forecast(polls, TIMING)

    assert prospect.watchdog_load > 1.0
    assert prospect.watchdog_gaps_s[1] == inf


def test_the_shortest_watchdog_is_served_first_and_none_at_all_last() -> None:
    polls = [poll("a"), poll("b", unit=2), poll("c", unit=3), poll("d", unit=4)]

    firsts_s = first_requests_s(polls, TIMING, limits_s={2: 0.0, 3: 5.0, 4: 2.0})

    assert sorted(firsts_s, key=firsts_s.__getitem__) == [4, 3, 1, 2]


def test_a_crash_costs_the_restart_and_the_first_round_and_a_hang_the_service_watchdog_too() -> None:
    gaps = gaps_of(1.2, 0.3, MANAGER)

    assert gaps.regular_s == 1.2
    assert gaps.crash_s == pytest.approx(1.2 + 0.5 + 1.0 + 0.3)
    assert gaps.hang_s - gaps.crash_s == pytest.approx(8.0 + 8.0 / 8 + 0.25 + 2.0)
    assert gaps.wanted_s == (WIDE_FACTOR * gaps.crash_s, WIDE_FACTOR * gaps.hang_s)


def test_the_utilisation_is_that_of_the_last_half_minute() -> None:
    statistics, asked = Statistics(), poll("status")
    statistics.begin(0.0)
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
