from __future__ import annotations

from gateway.line.rtu.confirmation import MOST_TRIES, Confirmation, Reading

SHORT, LONG = b"\x03\x02", b"\x03\x04"


def confirmed(part: object) -> Confirmation:
    confirmation = Confirmation()
    assert confirmation.take("a", part, SHORT, is_disturbed=False) is Reading.COUNTS
    return confirmation


def test_on_a_calm_line_each_reading_counts() -> None:
    assert confirmed(1).take("a", 2, SHORT, is_disturbed=False) is Reading.COUNTS


def test_on_a_disturbed_line_what_is_as_before_counts_at_once() -> None:
    assert confirmed(1).take("a", 1, SHORT, is_disturbed=True) is Reading.COUNTS


def test_on_a_disturbed_line_a_change_counts_when_another_shape_shows_it_too() -> None:
    confirmation = confirmed(1)

    assert confirmation.take("a", 2, SHORT, is_disturbed=True) is Reading.AGAIN
    assert confirmation.take("a", 2, SHORT, is_disturbed=True) is Reading.AGAIN
    assert confirmation.take("a", 2, LONG, is_disturbed=True) is Reading.COUNTS


def test_a_change_that_the_second_reading_does_not_show_is_never_told() -> None:
    confirmation = confirmed(1)

    assert confirmation.take("a", 2, SHORT, is_disturbed=True) is Reading.AGAIN
    assert confirmation.take("a", 1, LONG, is_disturbed=True) is Reading.COUNTS
    assert confirmation.take("a", 2, LONG, is_disturbed=True) is Reading.AGAIN


def test_where_there_is_one_shape_only_two_equal_readings_of_it_are_enough() -> None:
    confirmation = confirmed(1)

    readings = [confirmation.take("a", 2, SHORT, is_disturbed=True, has_alternates=False) for _ in range(2)]

    assert readings == [Reading.AGAIN, Reading.COUNTS]


def test_readings_that_never_agree_are_not_asked_for_without_end() -> None:
    confirmation = confirmed(0)

    readings = [confirmation.take("a", n, SHORT, is_disturbed=True) for n in range(1, 2 * MOST_TRIES + 1)]

    assert readings[MOST_TRIES - 1] is readings[2 * MOST_TRIES - 1] is Reading.OPEN
    assert Reading.COUNTS not in readings


def test_what_is_first_read_on_a_disturbed_line_needs_two_readings() -> None:
    confirmation = Confirmation()

    assert confirmation.take("a", 1, SHORT, is_disturbed=True) is Reading.AGAIN
    assert confirmation.take("a", 1, LONG, is_disturbed=True) is Reading.COUNTS
