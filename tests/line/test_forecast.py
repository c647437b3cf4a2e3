"""What a line is said to be like beforehand is what its plan then does."""

from __future__ import annotations

from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.line.forecast import Forecast, forecast, longest_gap_s
from gateway.line.job import Poll
from gateway.line.outcome import Answered
from gateway.line.plan import Plan
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming

TIMING = LineTiming(19200, Framing.parse("8E1"))


def poll(number: int, every_s: float, *, registers: int = 1, response_time_s: float = 0.02) -> Poll:
    request = ReadHoldingRegisters(0, registers)
    return Poll(f"p{number}", number, request, every_s, response_time_s)


def gaps_of(polls: list[Poll], prospect: Forecast, *, turns: int = 2000) -> dict[str, list[float]]:
    """Return the times between two answers of every poll, on a line where all take what was foretold."""
    plan = Plan(polls)
    plan.begin(0.0)
    costs_s = {each.poll.key: each.cost_s for each in prospect.polls}
    now_s, answered_s = 0.0, dict[str, float]()
    gaps: dict[str, list[float]] = {each.key: [] for each in polls}
    for _ in range(turns):
        turn = plan.pick(now_s)
        if turn is None:
            now_s = plan.next_due_s()
            continue
        assert turn.poll is not None
        now_s += costs_s[turn.poll.key]
        plan.record(turn, Answered((), now_s, 0.0), now_s)
        if turn.poll.key in answered_s:
            gaps[turn.poll.key].append(now_s - answered_s[turn.poll.key])
        answered_s[turn.poll.key] = now_s
    return gaps


def test_the_cost_of_a_poll_is_silence_request_response_time_and_reply() -> None:
    (each,) = forecast([poll(1, 1.0, registers=2)], TIMING).polls

    assert each.cost_s == pytest.approx(TIMING.silence_s + TIMING.wire_s(8) + 0.02 + TIMING.wire_s(9))


def test_load_is_the_share_of_the_lines_time_and_sweep_the_sum_of_all_polls() -> None:
    polls = [poll(1, 1.0), poll(2, 0.5), poll(3, 0.0)]

    prospect = forecast(polls, TIMING)

    cost_s = prospect.polls[0].cost_s
    assert prospect.load == pytest.approx(cost_s / 1.0 + cost_s / 0.5)
    assert prospect.sweep_s == pytest.approx(3 * cost_s)
    assert not prospect.is_overloaded


def test_a_line_that_is_fast_enough_keeps_every_period() -> None:
    polls = [poll(1, 1.0), poll(2, 0.1), poll(3, 10.0)]

    prospect = forecast(polls, TIMING)

    assert [each.period_s for each in prospect.polls] == [1.0, 0.1, 10.0]


def test_too_short_periods_are_stretched_evenly_and_long_ones_are_kept() -> None:
    polls = [*(poll(number, 0.1) for number in range(1, 11)), poll(11, 60.0)]

    prospect = forecast(polls, TIMING)

    gaps = gaps_of(polls, prospect)
    periods_s = [each.period_s for each in prospect.polls]
    assert prospect.is_overloaded
    assert sum(gaps["p1"]) / len(gaps["p1"]) == pytest.approx(periods_s[0], rel=0.01)
    assert len(set(periods_s[:-1])) == 1
    assert periods_s[0] == pytest.approx(10 * prospect.polls[0].cost_s, rel=0.01)
    assert periods_s[-1] == 60.0


def test_polls_as_fast_as_the_line_allows_share_what_the_others_leave() -> None:
    polls = [poll(1, 0.0), poll(2, 0.0), poll(3, 0.06)]

    prospect = forecast(polls, TIMING)

    cost_s = prospect.polls[0].cost_s
    assert prospect.polls[0].period_s == pytest.approx(3 * cost_s)  # all three in turn
    assert not prospect.is_overloaded


def test_a_unit_is_asked_as_often_as_its_fastest_poll() -> None:
    polls = [poll(1, 1.0), Poll("slow", 1, ReadHoldingRegisters(9, 1), 30.0, 0.02)]

    prospect = forecast(polls, TIMING, allowance_s=0.0)

    assert longest_gap_s(prospect, 1) == pytest.approx(1.0 + prospect.sweep_s)
    assert longest_gap_s(prospect, 2) == inf


def test_an_empty_line_has_no_load() -> None:
    prospect = forecast([], TIMING)

    assert (prospect.load, prospect.sweep_s, prospect.polls) == (0.0, 0.0, ())


@given(
    st.lists(
        st.tuples(st.sampled_from([0.0, 0.05, 0.1, 0.5, 1.0, 3.0]), st.integers(1, 60)),
        min_size=1,
        max_size=8,
    )
)
def test_the_plan_keeps_what_was_foretold(shapes: list[tuple[float, int]]) -> None:
    polls = [poll(number, every_s, registers=size) for number, (every_s, size) in enumerate(shapes, 1)]

    prospect = forecast(polls, TIMING, allowance_s=0.0)

    gaps = gaps_of(polls, prospect)
    for each in prospect.polls:
        assert max(gaps[each.poll.key], default=0.0) <= each.age_s + 1e-6
        settled = gaps[each.poll.key][5:]
        if len(settled) > 50 and each.poll.every_s >= prospect.sweep_s:  # it never loses its rhythm
            assert sum(settled) / len(settled) == pytest.approx(each.poll.every_s, rel=0.02)
