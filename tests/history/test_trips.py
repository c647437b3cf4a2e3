"""The last minute of readings, and the record of a trip that fits into 16 KB."""

import random
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.contract import ReadingTable
from gateway.plugins.history.ring import BEFORE_S, ReadingRing
from gateway.plugins.history.trips import MOST_BYTES, fitted
from tests.contract.examples import TRIP


def filled(every_s: float, until_s: float, **points: object) -> ReadingRing:
    """A ring in which these points were read again and again; a callable gives the value of a moment."""
    ring = ReadingRing()
    for count in range(round(until_s / every_s) + 1):
        at_s = count * every_s
        ring.note({n: v(at_s) if callable(v) else v for n, v in points.items()}, at_s=at_s)
    return ring


def test_a_ring_of_seldom_readings_keeps_little_that_is_older_than_a_minute() -> None:
    ring = filled(4.0, 900.0, current=lambda at_s: at_s)

    table = ring.around(900.0, before_s=900.0)

    assert -4 * BEFORE_S < table.t_s[0] < -BEFORE_S


def test_a_table_has_what_was_read_in_the_minute_before_a_moment() -> None:
    ring = filled(1.0, 300.0, current=lambda at_s: at_s, fault=lambda at_s: at_s >= 290.0, one=0.1, two=True)

    table = ring.around(300.0)

    assert table.t_s == tuple(float(t_s) for t_s in range(-60, 1))
    assert table.points["current"] == tuple(float(at_s) for at_s in range(240, 301))
    assert table.points["fault"][48:51] == (None, False, True)  # it is there where it changed
    assert ring.began_s("fault") == 290.0
    assert [(type(value), value) for value in table.constant.values()] == [(float, 0.1), (bool, True)]


def test_a_value_that_stood_since_before_the_window_is_there_from_its_beginning() -> None:
    ring = filled(1.0, 100.0, current=lambda at_s: 5.0 if at_s < 99 else 7.0)

    table = ring.around(100.0, before_s=10.0)

    assert table.t_s[0] == -10.0
    assert table.points["current"][0] == 5.0


def test_near_the_present_nothing_is_left_out_however_often_is_read() -> None:
    table = filled(0.05, 60.0, current=lambda at_s: at_s).around(60.0)

    newest = [t_s for t_s in table.t_s if t_s >= -5.0]
    assert newest == [round(-5.0 + 0.05 * n, 3) for n in range(101)]
    assert table.t_s[0] <= -10.0


@given(st.lists(st.tuples(st.floats(0.01, 9.0), st.sampled_from([0.0, 1.0, 2.5])), min_size=1, max_size=200))
def test_whatever_is_read_a_table_says_nothing_that_was_not_read(steps: list[tuple[float, float]]) -> None:
    ring, at_s, read = ReadingRing(), 0.0, []
    for pause_s, value in steps:
        at_s += pause_s
        ring.note({"current": value}, at_s=at_s)
        read.append((at_s, value))

    table = ring.around(at_s)

    column = table.points.get("current") or (table.constant["current"],) * len(table.t_s)
    assert list(table.t_s) == sorted(table.t_s)
    for t_s, value in zip(table.t_s, column, strict=True):
        before = [seen for seen_s, seen in read if seen_s <= at_s + t_s + 0.001]
        assert value in before[-2:]  # the second last where two moments are one millisecond
    assert column[-1] == read[-1][1]


@pytest.mark.parametrize(("points", "rows"), [(3, 60), (12, 240), (40, 1000)])
def test_a_record_has_at_most_16_kilobytes_and_still_the_10_seconds_before(points: int, rows: int) -> None:
    chance = random.Random(1)
    t_s = tuple(round(-60 + 62 * row / rows, 3) for row in range(rows))
    columns = {f"point_{n}": tuple(round(chance.uniform(0, 999), 1) for _ in t_s) for n in range(points)}
    at_fault = {f"D{n}": {"value": n, "unit": "A", "name": "x" * 40} for n in range(20)}

    found = fitted(replace(TRIP, readings=ReadingTable(t_s, columns, {}), at_fault=at_fault))

    assert len(found.payload()) <= MOST_BYTES
    assert found.readings.t_s[0] <= -10.0 + 2.0
    assert len(found.at_fault) == 20
    assert bool(found.thinned) is (rows > 60)
