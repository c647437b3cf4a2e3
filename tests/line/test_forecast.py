"""What is forecast of a line."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest

from gateway.families.diagnosis import decision_reads
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.schema import Variant
from gateway.line.capacity.line_forecast import forecast
from gateway.line.rtu.transaction import longest_s
from gateway.line.scheduler.requests import Poll
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.starters import StarterSetup, polls_of
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


def test_all_periods_of_an_over_full_line_are_stretched_by_one_factor() -> None:
    polls = [*(poll(number, 0.1) for number in range(1, 11)), poll(11, 3.0)]

    prospect = forecast(polls, TIMING)

    seen = average_gaps(polls, 60.0)
    assert prospect.is_overloaded
    assert prospect.factor == pytest.approx(prospect.load)
    for each in polls:
        assert seen[each.key] == pytest.approx(prospect.factor * each.every_s, rel=0.05)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_stop_waits_no_longer_for_what_commands_read_than_is_forecast(family: str) -> None:
    setup = StarterSetup("x", "x", 1, load_profile(family), Variant(), timing=TIMING)

    prospect = forecast(polls_of(setup), TIMING)

    for read in decision_reads(setup.profile):
        taken_s = longest_s(read, TIMING, response_time_s=setup.response_time_of(read))
        assert taken_s + TIMING.silence_s <= prospect.stop_latency_s


def test_watchdogs_that_need_more_than_the_line_has_are_not_met() -> None:
    polls = [replace(poll(number, 1.0), deadline_s=0.5) for number in range(1, 11)]

    prospect = forecast(polls, TIMING)

    assert prospect.watchdog_load > 1.0
    assert prospect.watchdog_gaps_s[1] == inf
