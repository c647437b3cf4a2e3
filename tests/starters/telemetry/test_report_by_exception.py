from __future__ import annotations

import asyncio
import math
from unittest.mock import patch

import pytest

from gateway.records import Quality
from gateway.starters.telemetry.reporting import REFRESH_S, TICK_S, TickTimer, is_news
from gateway.starters.telemetry.snapshot import Reading, Value
from tests.starters.telemetry.support import OfferedReport
from tests.virtual_time import VirtualClock, run_virtually

LATEST_S = REFRESH_S - TICK_S


def reading(value: Value, quality: Quality = Quality.GOOD, *, label: str | None = None) -> Reading:
    return Reading(value, "A", quality, label, 0.0, 0.0)


def sent(report: OfferedReport, value: Value, now_s: float, quality: Quality = Quality.GOOD) -> list[Value]:
    report.offer({"current": reading(value, quality)}, now_s=now_s)
    return [due.value for due in report.take_due(now_s).values()]


def test_a_change_soon_after_the_last_publication_waits_until_its_time() -> None:
    report = OfferedReport({})
    sent(report, 1.0, 10.0)

    assert sent(report, 2.0, 10.1) == []
    assert report.next_due_s() == 10.25
    assert report.take_due(10.25) == {"current": reading(2.0)}


def test_a_value_that_went_and_came_back_within_the_pause_is_published_again() -> None:
    report = OfferedReport({})
    sent(report, 1.0, 10.0)
    sent(report, 2.0, 10.1)
    sent(report, 1.0, 10.2)

    assert report.take_due(10.25) == {"current": reading(1.0)}


def test_a_report_without_points_is_never_due() -> None:
    report = OfferedReport({})

    assert report.next_due_s() == math.inf
    assert report.take_due(1e9) == {}


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
        (reading(True), reading(True), 0.0, False),
        (reading("a"), reading("b"), 5.0, True),
        (reading("a"), reading("a"), 0.0, False),
        (reading(7), reading(12), 5.0, False),
        (reading(7), reading(13), 5.0, True),
    ],
)
def test_news_is_a_change_of_quality_or_beyond_the_deadband(
    before: Reading, now: Reading, deadband: float, expected: bool
) -> None:
    assert is_news(before, now, deadband) is expected


def test_readings_that_were_sent_about_as_long_ago_go_out_together() -> None:
    report = OfferedReport({})
    report.offer({"current": reading(1.0)}, now_s=0.0)
    report.take_due(0.0)
    for at_s, name in ((20.0, "power"), (40.0, "voltage")):
        report.offer({name: reading(1.0)}, now_s=at_s)
        report.take_due(at_s)

    assert set(report.take_due(LATEST_S)) == {"current", "power"}
    assert report.next_due_s() == 40.0 + LATEST_S


def test_the_same_reading_offered_again_changes_nothing() -> None:
    report = OfferedReport({})
    same = {"current": reading(1.0)}
    report.offer(same, now_s=0.0)
    report.take_due(0.0)

    report.offer(same, now_s=1.0)

    assert report.next_due_s() == LATEST_S


def test_another_time_counts_at_once_for_what_was_sent_before() -> None:
    report = OfferedReport({})
    sent(report, 1.0, 0.0)

    report.set_refresh(10.0)

    assert report.next_due_s() == 10.0 - TICK_S
    assert report.take_due(10.0 - TICK_S) == {"current": reading(1.0)}


def test_another_time_loses_no_change_that_waits() -> None:
    report = OfferedReport({})
    sent(report, 1.0, 0.0)
    sent(report, 2.0, 0.1)

    report.set_refresh(3600.0)

    assert report.take_due(0.25) == {"current": reading(2.0)}


def test_a_timer_is_made_anew_only_for_an_earlier_tick() -> None:
    async def scenario() -> tuple[int, list[float]]:
        loop = asyncio.get_running_loop()
        clock, begun_s, called_s = VirtualClock(loop), loop.time(), list[float]()
        timer = TickTimer(clock, lambda: called_s.append(loop.time() - begun_s))
        with patch.object(loop, "call_later", wraps=loop.call_later) as made:
            for due_s in (1.9, 1.8, 2.0, 5.0, 0.9):
                timer.at(begun_s + due_s)
        await asyncio.sleep(10.0)
        return made.call_count, called_s

    made, called_s = run_virtually(scenario())

    assert made == 2
    assert called_s == pytest.approx([1.0], abs=TICK_S)
