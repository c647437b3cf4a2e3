import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.plugins.history.trip_recorder import ReadingRing


def filled(every_s: float, until_s: float, **points: object) -> ReadingRing:
    """A ring in which these points were read again and again; a callable gives the value of a moment."""
    ring = ReadingRing()
    for count in range(round(until_s / every_s) + 1):
        at_s = count * every_s
        ring.note({n: v(at_s) if callable(v) else v for n, v in points.items()}, at_s=at_s)
    return ring


def test_a_table_has_what_was_read_in_the_minute_before_a_moment() -> None:
    ring = filled(1.0, 300.0, current=lambda at_s: at_s)

    table = ring.around(300.0)

    assert table.t_s == tuple(float(t_s) for t_s in range(-60, 1))
    assert table.points["current"] == tuple(float(at_s) for at_s in range(240, 301))


def test_a_flag_that_went_on_shows_when() -> None:
    ring = filled(0.5, 100.0, fault=lambda at_s: at_s >= 90.0)

    table = ring.around(100.0)

    seen = dict(zip(table.t_s, table.points["fault"], strict=True))
    assert seen[-10.5] is False
    assert seen[-10.0] is True
    assert ring.began_s("fault") == 90.0


def test_a_value_that_stood_since_before_the_window_is_there_from_its_beginning() -> None:
    ring = filled(1.0, 100.0, current=lambda at_s: 5.0 if at_s < 99 else 7.0)

    table = ring.around(100.0, before_s=10.0)

    assert table.t_s[0] == -10.0
    assert table.points["current"][0] == 5.0


def test_near_the_present_nothing_is_left_out_however_often_is_read() -> None:
    ring = filled(0.05, 60.0, current=lambda at_s: at_s)

    table = ring.around(60.0)

    newest = [t_s for t_s in table.t_s if t_s >= -5.0]
    assert newest == [round(-5.0 + 0.05 * n, 3) for n in range(101)]
    assert table.t_s[0] <= -10.0


@pytest.mark.parametrize(("value", "kind"), [(True, bool), (3, int), (0.1, float), (60_000.5, float)])
def test_values_come_back_as_they_were_read(value: bool | int | float, kind: type) -> None:
    ring = filled(1.0, 5.0, one=value, other=lambda at_s: at_s)

    shown = ring.around(5.0).constant["one"]

    assert shown == value
    assert type(shown) is kind


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
