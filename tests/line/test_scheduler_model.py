"""The promises of the scheduler on random sites in virtual time: floods, offline starters, watchdogs.

Every reply comes as late as the line waits for it, every job takes as long as the site's longest request.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gateway.line.capacity.line_forecast import Forecast, forecast
from gateway.line.rtu.transaction import ALLOWANCE_S, Answered, Outcome, Silent, longest_s
from gateway.line.scheduler.line_time import JOBS_SHARE
from gateway.line.scheduler.polls import OFFLINE_BURST_S, OFFLINE_SHARE
from gateway.line.scheduler.requests import Job, Poll, Priority, Slot
from gateway.line.scheduler.scheduler import BACKGROUND_WEIGHT
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteRegister
from tests.line.ideal_line import READ, IdealLine, cost_s
from tests.line.line_rig import poll

TIMING = LineTiming(19200, Framing.parse("8E1"))
STOP = WriteRegister(1, 0)
OTHER = 99  # a unit without polls
FLOODS = (Priority.COMMAND, Priority.READ_BACK, Priority.PARAMETERS)


@dataclass(frozen=True)
class Site:
    """What a line is asked for."""

    polls: Sequence[Poll]
    offline: frozenset[int] = frozenset()
    floods: Sequence[Priority] = ()  # of each so many jobs wait at any time as there are units
    stops_every_s: float = inf


class Model(IdealLine):
    """A site under way."""

    def __init__(self, site: Site, *, seed: int = 0) -> None:
        self.site = site
        self.waits_s: list[float] = []  # of stops, until their frame begins
        self.offline_s = 0.0  # of the line's time, by units that were known to be silent
        self.longest_s = TIMING.silence_s + max(
            longest_s(each.request, TIMING, response_time_s=each.response_time_s) for each in site.polls
        )
        self._chance = random.Random(seed)
        self._late_s = {each.key: cost_s(each, TIMING, allowance_s=ALLOWANCE_S) for each in site.polls}
        self._stop_s = site.stops_every_s
        super().__init__(site.polls, self._duration_s, self._result, seed=seed)
        for lane in site.floods:
            for _ in range(1 + len(site.polls)):
                self._submit(lane, 0.0)

    def _submit(self, lane: Priority, at_s: float) -> None:
        self.scheduler.jobs.submit(Job(OTHER, READ, 0.01, lane, lambda outcome: None), at_s)

    def _duration_s(self, slot: Slot) -> float:
        took_s = self._late_s[slot.poll.key] if slot.poll is not None else self.longest_s
        if slot.unit in self.site.offline:
            took_s = self.longest_s
            if self.scheduler.polls.unit(slot.unit).is_silent:
                self.offline_s += took_s
        if slot.lane is Priority.STOP:
            self.waits_s.append(self.now_s - slot.since_s)
        elif slot.lane is not None:
            self._submit(slot.lane, self.now_s)
        if self._stop_s <= self.now_s + took_s:
            at_s = max(self._stop_s, self.now_s)
            self.scheduler.jobs.submit(Job(OTHER, STOP, 0.01, Priority.STOP, lambda outcome: None), at_s)
            self._stop_s = at_s + self._chance.uniform(0.5, 1.5) * self.site.stops_every_s
        return took_s

    def _result(self, slot: Slot, at_s: float) -> Outcome:
        return Silent() if slot.unit in self.site.offline else Answered((), at_s, 0.0)

    def run_first_round(self) -> None:
        """Serve until every unit was asked, and what that has delayed is over."""
        while any(
            unit not in self.served_s for unit in {each.unit for each in self.polls} - self.site.offline
        ):
            self.step()
        self.run(self.now_s + 5.0)
        self.unserved_s.clear()

    def used_by_jobs(self) -> float:
        """Return the share of the line's time that jobs have used."""
        return sum(self.longest_s for _, slot in self.slots if slot.lane in FLOODS) / self.now_s


def site_of(limits_s: Sequence[float | None], every_s: float, registers: int = 1, **more: object) -> Site:
    """Return starters with these watchdogs: a short block and one of so many registers each."""
    polls = [
        replace(poll(f"{unit}/{at}", unit, every_s, count=count), deadline_s=limit_s)
        for unit, limit_s in enumerate(limits_s, 1)
        for at, count in enumerate((1, registers))
    ]
    return Site(polls, **more)  # type: ignore[arg-type]


def forecast_of(site: Site) -> Forecast:
    return forecast(site.polls, TIMING)


def excess_s(model: Model) -> float:
    """Return by how much any promised gap was exceeded."""
    promised_s = forecast_of(model.site).watchdog_gaps_s
    found = (
        model.unserved_s[unit] - promised_s[unit] for unit in promised_s if unit not in model.site.offline
    )
    return max(found, default=-inf)


LIMITS_S = st.sampled_from([1.0, 2.0, 3.5, 5.0, 10.0, 30.0, None])
SITES = {
    "limits_s": st.lists(LIMITS_S, min_size=1, max_size=40),
    "every_s": st.sampled_from([0.0, 0.1, 1.0, 60.0]),
    "registers": st.integers(1, 60),
    "floods": st.sets(st.sampled_from(FLOODS)),
    "seed": st.integers(0, 9),
}


@settings(deadline=None, max_examples=60)
@given(**SITES)
@example(limits_s=[1.0] * 6 + [2.0, 3.5], every_s=0.0, registers=1, floods={Priority.COMMAND}, seed=0)
@example(limits_s=[1.0] * 6 + [2.0, 3.5], every_s=0.0, registers=1, floods=set(FLOODS), seed=0)
def test_no_watchdog_is_left_for_longer_than_promised_with_commands_under_way(
    limits_s: list[float | None], every_s: float, registers: int, floods: set[Priority], seed: int
) -> None:
    model = Model(site_of(limits_s, every_s, registers, floods=sorted(floods)), seed=seed)
    model.run_first_round()

    model.run(40.0)

    assert excess_s(model) <= 1e-9


@settings(deadline=None, max_examples=25)
@given(offline=st.sets(st.integers(1, 40), max_size=12), **SITES)
def test_a_starter_that_goes_offline_costs_two_silences_and_then_a_twentieth_of_the_line_at_most(
    limits_s: list[float | None],
    every_s: float,
    registers: int,
    floods: set[Priority],
    seed: int,
    offline: set[int],
) -> None:
    site = site_of(limits_s, every_s, registers, floods=sorted(floods), offline=frozenset(offline))
    model = Model(site, seed=seed)

    model.run_first_round()
    model.run(60.0)

    assert excess_s(model) <= 1e-9
    assert model.offline_s <= OFFLINE_SHARE * model.now_s + OFFLINE_BURST_S + model.longest_s


@settings(deadline=None, max_examples=25)
@given(stops_every_s=st.sampled_from([0.3, 2.0]), **SITES)
def test_a_stop_waits_for_the_request_on_the_wire_only(
    limits_s: list[float | None],
    every_s: float,
    registers: int,
    floods: set[Priority],
    seed: int,
    stops_every_s: float,
) -> None:
    site = site_of(limits_s, every_s, registers, floods=sorted(floods), stops_every_s=stops_every_s)
    model = Model(site, seed=seed)

    model.run(30.0)

    assert max(model.waits_s, default=0.0) <= forecast_of(site).stop_latency_s


@pytest.mark.parametrize("seed", range(4))
def test_starters_that_lose_their_supply_together_cost_no_other_its_watchdog(seed: int) -> None:
    polls = [
        replace(poll(f"{unit}/{at}", unit, every_s, count=count), response_time_s=0.2, deadline_s=12.5)
        for unit in range(1, 21)
        for at, (count, every_s) in enumerate(((3, 1.0), (12, 10.0)))
    ]
    model = Model(Site(polls), seed=seed)
    promised_s = forecast_of(model.site).watchdog_gaps_s
    model.run_first_round()
    model.run(60.0)

    model.site = replace(model.site, offline=frozenset(range(3, 21)))
    model.run(120.0)

    assert max(promised_s.values()) <= 12.5
    assert max(model.unserved_s[1], model.unserved_s[2]) <= 12.5


def test_a_flood_of_reads_gets_a_quarter_of_an_over_full_line_and_no_more() -> None:
    model = Model(site_of([None] * 8, 0.1, floods=[Priority.PARAMETERS]))

    model.run(120.0)

    assert model.used_by_jobs() == pytest.approx(JOBS_SHARE / BACKGROUND_WEIGHT, abs=0.03)


def test_a_flood_of_reads_leaves_the_polls_of_a_busy_line_their_rates() -> None:
    model = Model(site_of([None] * 8, 1.5, floods=[Priority.PARAMETERS]))  # two thirds of the line

    model.run(120.0)

    averages_s = [sum(gaps_s) / len(gaps_s) for gaps_s in model.gaps_s.values()]
    assert max(averages_s) < 1.05 * 1.5
    assert model.used_by_jobs() > 0.2
