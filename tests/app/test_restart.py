"""How long a restart leaves a starter alone: measured where it was, computed elsewhere, and announced."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any

import pytest

from gateway.app.capacity import prospects_of
from gateway.app.restart.gaps import (
    STOP_S,
    RestartGap,
    RestartTimes,
    announcement,
    restart_gaps,
    times_in,
)
from gateway.app.restart.watch import SETTLED_S, RestartWatch, process_age_s
from gateway.errors import DamagedError, StoreError
from gateway.line.capacity.outage import START_UP_S
from gateway.records import Quality, StateRecord
from tests.config.sites import site
from tests.starters.plant import FakeMemory
from tests.starters.rig import virtually

PROSPECTS = prospects_of(site())
LIMITS: dict[str, float | None] = {"pump-1": 5.0, "pump-2": None}


class Broken:
    """A store whose disk is away."""

    def load(self) -> Mapping[str, Any] | None:
        raise DamagedError("no")

    def set_aside(self) -> None:
        raise AssertionError("what was measured is no loss")

    async def save(self, document: Mapping[str, Any]) -> None:
        raise StoreError("full")


def state(starter: str, quality: Quality = Quality.GOOD) -> StateRecord:
    return StateRecord(starter, "ready", quality, 1.0, 1)


def gaps_with(times: RestartTimes) -> dict[str, RestartGap]:
    return {gap.starter: gap for gap in restart_gaps(PROSPECTS, times, limit_of=LIMITS.get)}


def test_what_was_measured_counts_and_what_was_not_is_computed_for_the_worst_case() -> None:
    gaps = gaps_with(RestartTimes(stop_s=0.5, start_s={"pump-1": 1.25}))

    (line,) = PROSPECTS
    one, two = line.starters
    assert gaps["pump-1"].gap_s == pytest.approx(one.gap_s + 0.5 + 1.25)
    assert gaps["pump-1"].is_measured
    assert gaps["pump-2"].gap_s == pytest.approx(two.gap_s + 0.5 + START_UP_S + two.first_poll_s)
    assert not gaps["pump-2"].is_measured
    assert gaps_with(RestartTimes(None, {"pump-1": 1.25}))["pump-1"].gap_s == one.gap_s + STOP_S + 1.25


@pytest.mark.parametrize(
    ("limit_s", "is_safe"), [(None, True), (2.9, False), (3.0, True), (0.5, False), (60.0, True)]
)
def test_a_watchdog_must_be_half_as_long_again_as_the_gap(limit_s: float | None, is_safe: bool) -> None:
    assert RestartGap("a", 2.0, True, limit_s).is_safe is is_safe


def test_the_announcement_names_the_longest_gap_and_the_watchdogs_that_may_act() -> None:
    text, data = announcement("ended by SIGTERM", PROSPECTS, RestartTimes(0.5, {}), limit_of=LIMITS.get)
    calm, quiet = announcement("x", PROSPECTS, RestartTimes(0.5, {}), limit_of=lambda _: None)

    assert text.startswith(
        "the gateway ends: ended by SIGTERM; if it is started again at once, nothing is polled"
    )
    assert text.endswith("longer than the watchdog of pump-1 allows")
    assert data["too_short"] == ["pump-1"]
    assert data["starter"] in LIMITS
    assert "watchdog" not in calm
    assert quiet["too_short"] == []


@virtually
async def test_a_start_is_measured_until_each_first_state_was_read_and_saved() -> None:
    memory = FakeMemory({"stop_s": 0.25, "start_s": {"old": 3.0, "pump-1": 9.0}})
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    watch = RestartWatch(memory, running_s=lambda: loop.time() - began_s)
    running = asyncio.create_task(watch.run())

    await asyncio.sleep(0.5)
    watch.put(state("pump-1", Quality.STALE))
    await asyncio.sleep(0.5)
    watch.put(state("pump-1"))
    await asyncio.sleep(1.0)
    watch.put(state("pump-1"))
    await asyncio.sleep(SETTLED_S)
    watch.put(state("late"))  # it was away: that says nothing of a restart
    await running

    assert memory.document == {"stop_s": 0.25, "start_s": {"old": 3.0, "pump-1": 1.0}}
    await watch.ended(0.0625)
    assert memory.document == {"stop_s": 0.062, "start_s": {"old": 3.0, "pump-1": 1.0}}


@virtually
async def test_a_disk_that_is_away_prevents_nothing() -> None:
    watch = RestartWatch(Broken(), running_s=lambda: 1.0)

    watch.put(state("pump-1"))
    await watch.run()
    await watch.ended(0.5)

    assert watch.times == RestartTimes(0.5, {"pump-1": 1.0})


@pytest.mark.parametrize(
    "document", [None, {}, {"stop_s": "x", "start_s": []}, {"stop_s": -1, "start_s": {"a": None, "b": True}}]
)
def test_times_that_make_no_sense_count_as_not_measured(document: Mapping[str, Any] | None) -> None:
    assert times_in(document) == RestartTimes(None, {})


def test_the_age_of_a_process_is_what_the_kernel_says() -> None:
    first = process_age_s()

    assert 0.0 < first <= process_age_s() < 86400.0
