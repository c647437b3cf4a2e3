"""What is forecast of a line."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest

from gateway.line.capacity.forecast import forecast
from gateway.line.scheduler.requests import Poll
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from tests.line.ideal_line import IdealLine, cost_s

TIMING = LineTiming(19200, Framing.parse("8E1"))


def poll(number: int, every_s: float, *, registers: int = 1, response_time_s: float = 0.02) -> Poll:
    request = ReadHoldingRegisters(0, registers)
    return Poll(f"p{number}", number, request, every_s, response_time_s)


def average_gaps(polls: list[Poll], run_s: float) -> dict[str, float]:
    """Return the average time between two answers of every poll, where all take what is foretold."""
    line = IdealLine(polls, lambda slot: cost_s(slot.poll, TIMING) if slot.poll else 0.0)
    line.run(run_s / 4)
    line.gaps_s.clear()
    line.run(run_s)
    return {key: sum(gaps) / len(gaps) for key, gaps in line.gaps_s.items() if gaps}


def test_a_stop_may_have_to_wait_for_the_longest_form_of_a_read() -> None:
    short, long = poll(1, 1.0, registers=2), poll(1, 1.0, registers=9)
    varied = replace(short, alternates_of=lambda _: ((long.request, lambda value: value),))

    assert forecast([varied], TIMING).stop_latency_s == forecast([long], TIMING).stop_latency_s
    assert forecast([varied], TIMING).stop_latency_s > forecast([short], TIMING).stop_latency_s


def test_the_cost_of_a_poll_is_silence_request_response_time_and_reply() -> None:
    (each,) = forecast([poll(1, 1.0, registers=2)], TIMING).polls

    assert each.cost_s == pytest.approx(TIMING.silence_s + TIMING.wire_s(8) + 0.02 + TIMING.wire_s(9))


def test_load_is_the_share_of_the_lines_time_and_sweep_the_sum_of_all_polls() -> None:
    polls = [poll(1, 1.0), poll(2, 0.5), poll(3, 0.0)]

    prospect = forecast(polls, TIMING)

    cost = prospect.polls[0].cost_s
    assert prospect.load == pytest.approx(cost / 1.0 + cost / 0.5)
    assert prospect.sweep_s == pytest.approx(3 * cost)
    assert not prospect.is_overloaded


def test_a_line_that_is_fast_enough_keeps_every_period() -> None:
    polls = [poll(1, 1.0), poll(2, 0.1), poll(3, 10.0)]

    prospect = forecast(polls, TIMING)

    assert [each.period_s for each in prospect.polls] == [1.0, 0.1, 10.0]


def test_all_periods_of_an_over_full_line_are_stretched_by_one_factor() -> None:
    polls = [*(poll(number, 0.1) for number in range(1, 11)), poll(11, 3.0)]

    prospect = forecast(polls, TIMING)

    seen = average_gaps(polls, 60.0)
    assert prospect.is_overloaded
    for each in prospect.polls:
        assert each.period_s == pytest.approx(prospect.load * each.poll.every_s)
        assert seen[each.poll.key] == pytest.approx(each.period_s, rel=0.05)


def test_polls_as_fast_as_the_line_allows_share_what_the_others_leave() -> None:
    polls = [poll(1, 0.0), poll(2, 0.0), poll(3, 0.1)]

    prospect = forecast(polls, TIMING)

    cost = prospect.polls[0].cost_s
    assert prospect.polls[0].period_s == pytest.approx(2 * cost / (1 - cost / 0.1))
    assert average_gaps(polls, 60.0)["p1"] == pytest.approx(prospect.polls[0].period_s, rel=0.05)


def test_a_unit_is_asked_as_often_as_its_fastest_poll() -> None:
    polls = [poll(1, 1.0), Poll("slow", 1, ReadHoldingRegisters(9, 1), 30.0, 0.02)]

    prospect = forecast(polls, TIMING, allowance_s=0.0)

    assert prospect.gaps_s[1] == pytest.approx(1.0 + prospect.sweep_s, rel=0.05)
    assert set(prospect.gaps_s) == {1}


def test_a_unit_with_a_watchdog_is_asked_in_time_however_long_its_periods_are() -> None:
    polls = [poll(1, 60.0), replace(poll(2, 60.0), deadline_s=10.0)]

    prospect = forecast(polls, TIMING)

    assert prospect.gaps_s[1] > 60.0
    assert 5.0 < prospect.gaps_s[2] < 5.5
    assert prospect.polls[1].period_s == 5.0


def test_a_watchdog_is_promised_what_the_polls_alone_keep_when_that_is_less() -> None:
    polls = [replace(poll(1, 1.0), deadline_s=30.0)]

    prospect = forecast(polls, TIMING)

    assert 1.0 < prospect.gaps_s[1] < prospect.watchdog_gaps_s[1] < 3.0


def test_watchdogs_that_need_more_than_the_line_has_are_not_met() -> None:
    polls = [replace(poll(number, 1.0), deadline_s=0.5) for number in range(1, 11)]

    prospect = forecast(polls, TIMING)

    assert prospect.watchdog_load > 1.0
    assert prospect.watchdog_gaps_s[1] == inf
