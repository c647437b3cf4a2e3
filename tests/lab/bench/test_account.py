"""The bench's evaluation, on lines made by hand: a wrong figure would be believed."""

from __future__ import annotations

import math

import pytest

from gateway.modbus.timing import Framing, LineTiming
from tests.lab.bench.account import Law, SeenRequest, Submitted, account, stops, sweeps_s
from tests.lab.bench.report import Goal

LAW = Law(LineTiming(19200, Framing.parse("8N2")), delay_s=0.005)
SILENCE_S, WIRE_S = LAW.timing.silence_s, LAW.timing.wire_s(8 + 25)
IDEAL_S = 0.005 + WIRE_S + SILENCE_S


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


@pytest.mark.parametrize(("idle_s", "late_s"), [(0.0, 0.0), (0.001, 0.0), (0.001, 0.001)])
def test_idle_time_lowers_the_efficiency_by_its_share_but_the_judges_own_lateness(
    idle_s: float, late_s: float
) -> None:
    found = account([each._replace(late_s=late_s) for each in line(idle_s, idle_s)], LAW)

    assert found.efficiency == pytest.approx(IDEAL_S / (IDEAL_S + idle_s - late_s))
    assert found.whole == pytest.approx(IDEAL_S / (IDEAL_S + idle_s))
    assert found.idle_s == pytest.approx(idle_s)
    assert (found.answered, found.requests, found.too_soon) == (2, 3, 0)


def test_a_request_is_too_soon_only_beyond_the_tolerance() -> None:
    assert [account(line(idle_s, 0.0), LAW).too_soon for idle_s in (-0.00004, -0.00006)] == [0, 1]


def test_time_of_unanswered_requests_is_the_share_of_the_silent() -> None:
    living = line(0.0)
    dead = line(0.0, is_answered=False, begun_s=living[-1].end_s + SILENCE_S)

    found = account([*living, *dead], LAW)

    assert found.answered == 2
    assert 0.0 < found.silent_share < 1.0
    assert found.whole + found.silent_share == pytest.approx(1.0)


@pytest.mark.parametrize(  # given after the beginning of the request under way, 2 ms too late on the line
    ("after_s", "excess_s", "is_crossed"),
    [(0.001, 0.002, False), (-0.0009, 0.002, True), (-0.0011, 0.002 + IDEAL_S, False)],
)
def test_a_stop_is_charged_for_what_it_need_not_have_waited(
    after_s: float, excess_s: float, is_crossed: bool
) -> None:
    seen = line(0.0)
    write = SeenRequest(0, seen[-1].end_s + SILENCE_S + 0.002, 7, 5, 8, 8, 0.0, SILENCE_S + 0.002, 0.0)

    (found,) = stops([*seen, write], [Submitted(0.0, seen[-1].start_s + after_s, 7)], LAW)

    assert found.excess_s == pytest.approx(excess_s)
    assert found.is_crossed is is_crossed


def test_a_stop_that_never_came_is_not_counted() -> None:
    assert stops(line(0.0), [Submitted(0.0, 100.001, 7), Submitted(0.0, 99.0, 1)], LAW) == []


def test_sweeps_are_the_times_between_requests_to_one_unit() -> None:
    assert sweeps_s([*line(0.0), *line(0.0, unit=2)]) == pytest.approx([IDEAL_S] * 2)


def test_a_goal_is_met_at_its_limit_and_never_by_nothing_measured() -> None:
    goals = Goal("at least", 0.99, 0.99), Goal("most", 0, 0, is_most=True), Goal("none", math.nan, 0.0)

    assert [goal.is_met for goal in goals] == [True, True, False]
