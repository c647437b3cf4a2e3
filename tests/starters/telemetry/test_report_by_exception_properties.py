"""Whatever the readings and their times: no change is lost, none comes too soon, none too late."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.contract import Quality
from gateway.starters.telemetry.reporting import REFRESH_S, SOONEST_S, TICK_S, Report, TickTimer, is_news
from gateway.starters.telemetry.snapshot import Reading, Value
from tests.virtual_time import VirtualClock, run_virtually

DEADBAND = 1.0
EPSILON_S = 1e-9


@dataclass(frozen=True)
class Step:
    after_s: float
    value: float
    quality: Quality


steps = st.lists(
    st.builds(
        Step,
        after_s=st.sampled_from([0.0, 0.01, 0.1, 0.2, 0.25, 0.3, 1.0, 29.0, 299.0, 301.0]),
        value=st.floats(-5, 5, allow_nan=False),
        quality=st.sampled_from([Quality.GOOD, Quality.GOOD, Quality.STALE]),
    ),
    min_size=1,
    max_size=40,
)


@dataclass(frozen=True)
class Sent:
    at_s: float
    reading: Reading


class OfferedReport(Report):
    """As telemetry has it: the readings are stored first, then it is noted which have changed."""

    def __init__(self, deadbands: Mapping[str, float]) -> None:
        self._offered: dict[str, Reading] = {}
        super().__init__(self._offered, deadbands)

    def offer(self, readings: Mapping[str, Reading], *, now_s: float) -> None:
        """Store readings that say something else than before."""
        self._offered.update(readings)
        self.note_changed(readings, now_s=now_s)


def play(story: list[Step]) -> tuple[list[Sent], list[tuple[float, Reading]]]:
    """Offer the readings in their time and publish exactly when the report says so."""
    report = OfferedReport({"p": DEADBAND})
    published: list[Sent] = []
    offered: list[tuple[float, Reading]] = []
    now_s = 0.0
    for step in story:
        target_s = now_s + step.after_s
        while report.next_due_s() <= target_s:
            now_s = report.next_due_s()
            published += [Sent(now_s, reading) for reading in report.take_due(now_s).values()]
        now_s = target_s
        reading = Reading(step.value, "A", step.quality, None, now_s, now_s)
        offered.append((now_s, reading))
        report.offer({"p": reading}, now_s=now_s)
        published += [Sent(now_s, due) for due in report.take_due(now_s).values()]
    end_s = report.next_due_s()
    published += [Sent(end_s, due) for due in report.take_due(end_s).values()]
    return published, offered


@given(steps)
def test_no_point_is_published_twice_within_a_quarter_of_a_second(story: list[Step]) -> None:
    published, _ = play(story)

    gaps_s = [later.at_s - earlier.at_s for earlier, later in itertools.pairwise(published)]
    assert all(gap_s >= SOONEST_S - EPSILON_S for gap_s in gaps_s)


@given(steps)
def test_no_point_is_silent_for_more_than_its_refresh_time(story: list[Step]) -> None:
    published, _ = play(story)

    gaps_s = [later.at_s - earlier.at_s for earlier, later in itertools.pairwise(published)]
    assert all(gap_s <= REFRESH_S + EPSILON_S for gap_s in gaps_s)


@given(steps)
def test_what_is_published_is_always_the_newest_reading(story: list[Step]) -> None:
    published, offered = play(story)

    for sent in published:
        newest = [reading for at_s, reading in offered if at_s <= sent.at_s]
        assert any(sent.reading is reading for reading in newest)
        later = [at_s for at_s, _ in offered if (sent.reading.at_s or 0.0) < at_s < sent.at_s]
        assert later == []


@given(steps)
def test_no_change_is_ever_lost(story: list[Step]) -> None:
    published, offered = play(story)

    _, last = offered[-1]
    final = published[-1].reading
    assert final.quality is last.quality
    assert isinstance(final.value, float)
    assert isinstance(last.value, float)
    assert abs(final.value - last.value) <= DEADBAND


def reading(value: Value, quality: Quality = Quality.GOOD, *, label: str | None = None) -> Reading:
    return Reading(value, "A", quality, label, 0.0, 0.0)


@pytest.mark.parametrize(
    ("before", "now", "deadband", "expected"),
    [
        (reading(1.0), reading(1.0), 0.0, False),
        (reading(1.0), reading(1.1), 0.0, True),
        (reading(1.0), reading(1.0, Quality.STALE), 5.0, True),
        (reading(1, label="on"), reading(1, label="off"), 5.0, True),
        (reading(None), reading(1.0), 5.0, True),
        (reading(1.0), reading(None), 5.0, True),
        (reading(None), reading(None), 0.0, False),
        (reading(False), reading(True), 5.0, True),
        (reading("a"), reading("b"), 5.0, True),
        (reading("a"), reading("a"), 0.0, False),
        (reading(7), reading(12), 5.0, False),
        (reading(7), reading(13), 5.0, True),
    ],
)
def test_news_is_a_change_of_quality_or_beyond_the_deadband(
    before: Reading, now: Reading, deadband: float, *, expected: bool
) -> None:
    assert is_news(before, now, deadband) is expected


def test_a_timer_calls_once_at_the_earliest_of_the_times_it_was_given() -> None:
    async def scenario() -> list[float]:
        loop = asyncio.get_running_loop()
        begun_s, called_s = loop.time(), list[float]()
        timer = TickTimer(VirtualClock(loop), lambda: called_s.append(loop.time() - begun_s))
        for due_s in (1.9, 1.8, 2.0, 5.0, 0.9):
            timer.at(begun_s + due_s)
        await asyncio.sleep(10.0)
        return called_s

    assert run_virtually(scenario()) == pytest.approx([0.9], abs=2 * TICK_S)
