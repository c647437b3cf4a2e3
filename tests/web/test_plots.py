"""The rings behind sparklines and plots."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from gateway.plugins.web.plots import NAN, Ring, numbers, thinned


def test_a_value_holds_until_the_next_one_and_nothing_is_known_before_the_first() -> None:
    ring = Ring(2.0, 5, is_peak=True)

    ring.put(7.0, 100.0)
    ring.put(3.0, 105.0)

    assert numbers(ring.values(107.0)) == [None, 7.0, 7.0, 7.0, 3.0]  # 7 A until 105 s


def test_a_value_that_is_not_good_leaves_a_gap_until_it_is_again() -> None:
    ring = Ring(1.0, 6, is_peak=True)

    ring.put(5.0, 0.0)
    ring.put(NAN, 2.0)
    ring.put(6.0, 4.0)

    assert numbers(ring.values(5.0)) == [5.0, 5.0, None, None, 6.0, 6.0]


def test_of_several_values_in_a_step_a_peak_ring_has_the_largest_and_goes_on_with_the_last() -> None:
    peak, last = Ring(10.0, 2, is_peak=True), Ring(10.0, 2, is_peak=False)

    for ring in (peak, last):
        for value in (1.0, 480.0, 12.0):
            ring.put(value, 3.0)

    assert numbers(peak.values(13.0)) == [480.0, 12.0]
    assert numbers(last.values(13.0)) == [12.0, 12.0]


def test_a_pause_longer_than_the_ring_fills_it_with_what_was_held() -> None:
    ring = Ring(1.0, 3, is_peak=False)

    ring.put(2.0, 0.0)

    assert numbers(ring.values(1_000_000.0)) == [2.0, 2.0, 2.0]


@given(
    st.lists(st.tuples(st.floats(0, 500), st.floats(-1000, 1000, width=16)), min_size=1, max_size=40).map(
        lambda items: sorted(items, key=lambda item: item[0])
    )
)
def test_the_newest_slot_is_the_last_value_wherever_the_ring_has_wrapped(
    puts: list[tuple[float, float]],
) -> None:
    ring = Ring(2.0, 7, is_peak=False)

    for at_s, value in puts:
        ring.put(value, at_s)

    values = ring.values(puts[-1][0])
    assert len(values) == 7
    assert values[-1] == puts[-1][1]


def test_thinning_shows_the_peak_of_each_run() -> None:
    assert thinned([1.0, 9.0, NAN, 2.0, NAN, NAN], 3)[:2] == [9.0, 2.0]
    assert math.isnan(thinned([1.0, 9.0, NAN, 2.0, NAN, NAN], 3)[2])
    assert thinned([1.0, 2.0], 60) == [1.0, 2.0]
