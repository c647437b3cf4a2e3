from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.plugins.history.counters import MotorCounters, band_of, counted
from gateway.starters import Readings


def readings(at_s: float, **values: Any) -> Readings:
    return Readings(at_s, at_s, "", values)


@pytest.mark.parametrize(
    ("period_s", "read", "hours_s", "bands_s"),
    [
        (1.0, [(0, 10, {}), (3610, 3620, {})], 20.0, {}),  # a gap does not count, whatever the state
        (600.0, [(0, 36_000, {})], 36_000.0, {}),  # it is read once in ten minutes
        (
            1.0,
            [(0, 10, {"current_pct": 40.0}), (11, 20, {"current_pct": 95.0})],
            20.0,
            {"low": 11, "high": 9},
        ),
        (1.0, [(0, 10, {"current": 65.0})], 10.0, {"over": 10}),  # of a rated current of 50 A
    ],
)
def test_time_counts_between_readings_by_the_load_that_was_read_last(
    period_s: float, read: list[tuple[int, int, dict[str, float]]], hours_s: float, bands_s: dict[str, float]
) -> None:
    counters = MotorCounters(period_s=period_s)
    counters.rated_a = 50.0
    counters.note_state("running")

    for since_s, until_s, load in read:
        for at_s in range(since_s, until_s + 1, round(period_s)):
            counters.note_readings(readings(at_s, running=True, **load))

    assert counters.totals.operating_s == hours_s
    assert {name: amount for name, amount in counters.totals.bands_s.items() if amount} == bands_s
    assert counters.has_load is bool(bands_s)


@pytest.mark.parametrize(
    ("load", "band"), [(0, "low"), (49.9, "low"), (50, "normal"), (90, "high"), (120, "over"), (600, "over")]
)
def test_bands_of_load(load: float, band: str) -> None:
    assert band_of(load) == band


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
