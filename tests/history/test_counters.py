from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.plugins.history.counters import MotorCounters, band_of, counted
from gateway.starters import Readings


def readings(at_s: float, **values: Any) -> Readings:
    return Readings(at_s, at_s, "", values)


def run(
    counters: MotorCounters, since_s: float, until_s: float, *, every_s: float = 1.0, **more: Any
) -> None:
    at_s = since_s
    while at_s <= until_s + 1e-9:
        counters.note_readings(readings(at_s, running=counters.is_operating, **more))
        at_s += every_s


def test_a_gap_between_readings_does_not_count_even_where_the_state_stayed_known() -> None:
    counters = MotorCounters(period_s=1.0)
    counters.note_state("running")
    run(counters, 0, 10)
    run(counters, 3610, 3620)

    assert counters.totals.operating_s == 20.0


def test_a_starter_that_is_read_once_in_ten_minutes_counts_all_the_same() -> None:
    counters = MotorCounters(period_s=600.0)
    counters.note_state("running")
    run(counters, 0, 36_000, every_s=600.0)

    assert counters.totals.operating_s == 36_000.0


@pytest.mark.parametrize(
    ("load", "band"), [(0, "low"), (49.9, "low"), (50, "normal"), (90, "high"), (120, "over"), (600, "over")]
)
def test_bands_of_load(load: float, band: str) -> None:
    assert band_of(load) == band


def test_hours_by_load_follow_the_load_that_was_read_last() -> None:
    counters = MotorCounters()
    counters.note_state("running")
    run(counters, 0, 10, current_pct=40.0)
    run(counters, 11, 20, current_pct=95.0)

    bands = counters.totals.bands_s
    assert bands == {"low": 11.0, "normal": 0.0, "high": 9.0, "over": 0.0}


def test_the_load_follows_from_the_current_where_the_rated_current_is_known() -> None:
    counters = MotorCounters()
    counters.rated_a = 50.0
    counters.note_state("running")
    run(counters, 0, 10, current=65.0)

    assert counters.totals.bands_s["over"] == 9.0 + 1.0


def test_without_a_load_hours_count_and_no_band_does() -> None:
    counters = MotorCounters()
    counters.note_state("running")
    run(counters, 0, 10, current=65.0)

    assert counters.totals.operating_s == 10.0
    assert sum(counters.totals.bands_s.values()) == 0.0
    assert not counters.has_load


def test_trips_count_by_code_within_bounds() -> None:
    counters = MotorCounters()
    for number in range(200):
        counters.note_trip(f"e{number}")
    counters.note_trip("e5")

    trips = counters.totals.trips
    assert trips["e5"] == 2
    assert sum(trips.values()) == 201
    assert len(trips) == 65


@pytest.mark.parametrize(
    "wrong", [{"starts": -1}, {"operating_s": float("inf")}, {"trips": {"e05": "many"}}, {"bands_s": [1.0]}]
)
def test_what_is_no_count_is_as_good_as_missing(wrong: dict[str, Any]) -> None:
    one = {"totals": {"starts": 3}, "thermal": {"taus_s": [600.0], "heatings": []}}
    later = {"totals": {"starts": 2}, "thermal": {"taus_s": [1200.0], "heatings": []}}

    found = counted([one, {"totals": wrong}, later])

    assert found.totals.starts == 5
    assert found.thermal.taus_s == (600.0, 1200.0)


@given(
    st.lists(
        st.tuples(st.floats(0.0, 50.0), st.sampled_from(["running", "ready", "unknown", "fault", "starting"]))
    )
)
def test_never_more_time_counts_than_has_passed(steps: list[tuple[float, str]]) -> None:
    counters, at_s = MotorCounters(), 0.0
    for pause_s, state in steps:
        at_s += pause_s
        counters.note_readings(readings(at_s, running=True, current_pct=80.0))
        counters.note_state(state)

    totals = counters.totals
    assert 0.0 <= totals.operating_s <= at_s
    assert sum(totals.bands_s.values()) <= totals.operating_s + 1e-6
