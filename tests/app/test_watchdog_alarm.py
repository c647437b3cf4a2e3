"""What is reported of starters' watchdogs that a line does not keep."""

from __future__ import annotations

from gateway.app.health import QUIET_S, WatchdogAlarm


def reported(*seen: tuple[float, float, float, int]) -> list[str | None]:
    alarm = WatchdogAlarm()
    return [
        alarm.take({"load": load, "longest_share": share, "unit": unit}, now_s)
        for now_s, load, share, unit in seen
    ]


def test_watchdogs_that_are_served_are_not_reported() -> None:
    assert reported((0.0, 0.9, 0.7, 3), (60.0, 0.0, 0.0, 0)) == [None, None]


def test_watchdogs_that_need_more_than_there_is_are_reported_once() -> None:
    texts = reported((0.0, 1.2, 0.7, 3), (1.0, 1.3, 0.7, 3), (2.0, 0.9, 0.7, 3), (3.0, 1.1, 0.7, 3))

    assert texts[0] == "the starters' watchdogs need 120% of its time: not all can be served in time"
    assert texts[1:3] == [None, None]
    assert texts[3] is not None


def test_each_starter_that_was_left_too_long_is_reported_once() -> None:
    texts = reported((0.0, 0.1, 1.5, 3), (1.0, 0.1, 1.5, 3), (2.0, 0.1, 1.6, 4), (1.0 + QUIET_S, 0.1, 1.2, 3))

    assert texts[0] == "address 3 was left for 150% of its watchdog's time: it may have acted"
    assert texts[1] is None
    assert [text[:9] for text in texts[2:] if text is not None] == ["address 4", "address 3"]


def test_what_goes_on_is_not_reported_again() -> None:
    assert reported(*((at * 100.0, 0.1, 1.5, 3) for at in range(10)))[1:] == [None] * 9
