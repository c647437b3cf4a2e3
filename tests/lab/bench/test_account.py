"""The bench's evaluation, on lines made by hand."""

from __future__ import annotations

import math

import pytest

from gateway.modbus.timing import Framing, LineTiming
from tests.lab.bench.account import (
    Law,
    SeenRequest,
    Stop,
    Submitted,
    account,
    between,
    stops,
    sweeps_s,
)
from tests.lab.bench.report import Goal

LAW = Law(LineTiming(19200, Framing.parse("8N2")), delay_s=0.005)
SILENCE_S = LAW.timing.silence_s
WIRE_S = LAW.timing.wire_s(8 + 25)


def line(
    *idles_s: float, unit: int = 1, is_answered: bool = True, begun_s: float = 100.0
) -> list[SeenRequest]:
    """Return requests, each so long after the silence that follows the one before."""
    seen: list[SeenRequest] = []
    at_s, gap_s = begun_s, 1.0
    for idle_s in (0.0, *idles_s):
        if seen:
            gap_s = SILENCE_S + idle_s
            at_s = seen[-1].end_s + gap_s
        end_s = at_s + (0.005 + WIRE_S if is_answered else LAW.timing.wire_s(8))
        seen.append(SeenRequest(0, at_s, unit, 3, 8, 25 if is_answered else 0, end_s, gap_s, 0.0))
    return seen


def test_a_line_without_idle_time_is_fully_efficient() -> None:
    found = account(line(0.0, 0.0, 0.0), LAW)

    assert found.efficiency == pytest.approx(1.0)
    assert found.whole == pytest.approx(1.0)
    assert (found.answered, found.requests, found.too_soon) == (3, 4, 0)


def test_idle_time_lowers_the_efficiency_by_its_share() -> None:
    ideal_s = 0.005 + WIRE_S + SILENCE_S

    found = account(line(0.001, 0.001), LAW)

    assert found.efficiency == pytest.approx(ideal_s / (ideal_s + 0.001))
    assert found.idle_s == pytest.approx(0.001)


def test_the_judges_own_lateness_is_not_the_masters() -> None:
    late = [each._replace(late_s=0.001) for each in line(0.001, 0.001)]

    assert account(late, LAW).efficiency == pytest.approx(1.0)


def test_a_request_is_too_soon_only_beyond_the_tolerance() -> None:
    assert account(line(-0.00004, 0.0), LAW).too_soon == 0
    assert account(line(-0.00006, 0.0), LAW).too_soon == 1


def test_time_of_unanswered_requests_is_the_share_of_the_silent() -> None:
    living = line(0.0)
    dead = line(0.0, is_answered=False, begun_s=living[-1].end_s + SILENCE_S)

    found = account([*living, *dead], LAW)

    assert found.answered == 2
    assert 0.0 < found.silent_share < 1.0
    assert found.whole + found.silent_share == pytest.approx(1.0)


def test_a_stop_is_charged_only_for_what_it_need_not_have_waited() -> None:
    seen = line(0.0)
    write = SeenRequest(0, seen[-1].end_s + SILENCE_S + 0.002, 7, 5, 8, 8, 0.0, SILENCE_S + 0.002, 0.0)

    (found,) = stops([*seen, write], [Submitted(0.0, seen[-1].start_s + 0.001, 7)], LAW)

    assert found.excess_s == pytest.approx(0.002)
    assert found.latency_s == pytest.approx(found.under_way_s - 0.001 + 0.002)


def test_a_stop_that_misses_a_request_by_a_hair_waits_for_that_one_transaction() -> None:
    seen = line(0.0)
    write = SeenRequest(0, seen[-1].end_s + SILENCE_S + 0.002, 7, 5, 8, 8, 0.0, SILENCE_S + 0.002, 0.0)

    def stop(before_s: float) -> Stop:
        (found,) = stops([*seen, write], [Submitted(0.0, seen[-1].start_s - before_s, 7)], LAW)
        return found

    assert stop(0.0009).is_crossed
    assert not stop(0.0011).is_crossed
    assert stop(0.0009).excess_s == pytest.approx(0.002)
    assert stop(0.0011).excess_s > 0.005


def test_a_stop_that_never_came_is_not_counted() -> None:
    assert stops(line(0.0), [Submitted(0.0, 100.001, 7), Submitted(0.0, 99.0, 1)], LAW) == []


def test_sweeps_are_the_times_between_requests_to_one_unit() -> None:
    seen = [*line(0.0), *line(0.0, unit=2)]

    assert sweeps_s(seen) == pytest.approx([0.005 + WIRE_S + SILENCE_S] * 2)
    assert between(seen, 100.0, 100.001) == [seen[0], seen[2]]


def test_a_goal_is_met_at_its_limit_and_never_by_nothing_measured() -> None:
    assert Goal("at least", 0.99, 0.99).is_met
    assert Goal("at most", 0, 0, is_most=True).is_met
    assert not Goal("nothing", math.nan, 0.0, is_most=True).is_met
    assert Goal("low", 0.5, 0.99).cells() == ("low", "0.5", ">= 0.99", "MISSED")
