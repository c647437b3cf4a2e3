from __future__ import annotations

from gateway.families.profile.rows import Alarm
from gateway.starters.telemetry.transitions import AlarmBook, AlarmStatus

E05 = Alarm(code="e05", severity="fault", text="Overload")
A01 = Alarm(code="a01", severity="alarm", text="Hot")


def test_an_alarm_that_comes_is_active_and_counted() -> None:
    book = AlarmBook()

    assert book.update([E05], time_s=10.0) == (AlarmStatus(E05, True, 10.0, None, 1),)


def test_an_alarm_that_stays_is_no_news() -> None:
    book = AlarmBook()
    book.update([E05], time_s=10.0)

    assert book.update([E05], time_s=11.0) == ()


def test_an_alarm_that_goes_is_cleared_with_its_time() -> None:
    book = AlarmBook()
    book.update([E05, A01], time_s=10.0)

    assert book.update([A01], time_s=12.0) == (AlarmStatus(E05, False, 10.0, 12.0, 1),)


def test_an_alarm_that_comes_again_is_counted_again() -> None:
    book = AlarmBook()
    book.update([E05], time_s=10.0)
    book.update([], time_s=11.0)

    assert book.update([E05], time_s=12.0) == (AlarmStatus(E05, True, 12.0, None, 2),)


def test_an_alarm_that_went_long_ago_is_no_news_either() -> None:
    book = AlarmBook()
    book.update([E05], time_s=10.0)
    book.update([], time_s=11.0)

    assert book.update([], time_s=12.0) == ()
