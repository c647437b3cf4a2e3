"""How long a unit receives nothing after a failure, and in which order a start asks."""

from __future__ import annotations

import pytest

from gateway.line.capacity.outage import WIDE_FACTOR, Restart, first_requests_s, gaps_of
from gateway.modbus.timing import Framing, LineTiming
from tests.line.fakes import poll

TIMING = LineTiming(19200, Framing.parse("8E1"))
MANAGER = Restart(restart_s=0.5, watchdog_s=8.0, abort_s=2.0, start_up_s=1.0)


def test_the_shortest_watchdog_is_served_first_and_none_at_all_last() -> None:
    polls = [poll("a"), poll("b", unit=2), poll("c", unit=3), poll("d", unit=4)]

    firsts_s = first_requests_s(polls, TIMING, limits_s={2: 0.0, 3: 5.0, 4: 2.0})

    assert sorted(firsts_s, key=firsts_s.__getitem__) == [4, 3, 1, 2]


def test_a_crash_costs_the_restart_the_start_up_and_the_first_round() -> None:
    gaps = gaps_of(1.2, 0.3, MANAGER)

    assert gaps.regular_s == 1.2
    assert gaps.crash_s == pytest.approx(1.2 + 0.5 + 1.0 + 0.3)


def test_a_hang_costs_the_service_watchdog_on_top() -> None:
    gaps = gaps_of(1.2, 0.3, MANAGER)

    assert gaps.hang_s - gaps.crash_s == pytest.approx(8.0 + 8.0 / 8 + 0.25 + 2.0)
    assert gaps.wanted_s == (WIDE_FACTOR * gaps.crash_s, WIDE_FACTOR * gaps.hang_s)
