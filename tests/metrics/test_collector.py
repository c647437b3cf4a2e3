"""What a scrape says of a gateway, judged by prometheus-client's parser; what is not known has no sample."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.contract import Quality
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.plugins.metrics.catalogue import MOTOR_POINTS, SPECS
from gateway.plugins.metrics.collector import exposition, fault_codes
from gateway.plugins.metrics.counts import Counted
from gateway.starters.telemetry.decoding import unit_of
from gateway.starters.telemetry.snapshot import Reading
from tests.metrics.support import NOW_S, Scrape, gathered, good, starter


def scrape(*starters: Any, **more: Any) -> Scrape:
    return Scrape(exposition(gathered(*starters, **more)))


def of_starter(**changes: Any) -> Scrape:
    return scrape(starter(**changes))


def test_a_histogram_sums_up_its_buckets_and_ends_with_infinity() -> None:
    found = scrape()

    assert found.types["loop_lag_seconds"] == "histogram"
    assert [found.one("loop_lag_seconds_bucket", le=le) for le in ("0.002", "0.005", "+Inf")] == [0, 1, 1]
    assert found.one("loop_lag_seconds_count") == 1.0
    assert found.one("loop_lag_seconds_sum") == 0.005


def test_without_a_page_there_is_no_count_of_open_pages() -> None:
    assert scrape().one("web_streams") == 2.0
    assert scrape(streams=None).all("web_streams") == []


def test_one_state_is_1_and_the_six_others_are_0() -> None:
    found = of_starter(state="starting")

    assert sorted(found.all("starter_state")) == [0.0] * 6 + [1.0]
    assert found.one("starter_state", state="starting") == 1.0


def test_requests_and_response_times_are_the_units_own() -> None:
    found = of_starter()

    assert found.one("starter_polls_total", starter="pump-1", outcome="silent") == 5.0
    assert found.one("polls_total", line="pumps", outcome="answered") == 190.0
    assert found.types["starter_response_seconds"] == "summary"
    assert found.one("starter_response_seconds", quantile="0.5") == 0.01
    assert found.all("starter_response_seconds", quantile="0.99") == []  # not known yet


@pytest.mark.parametrize("quality", [Quality.STALE, Quality.BAD])
def test_a_value_that_is_not_good_is_left_out_and_the_time_of_the_last_good_one_stays(
    quality: Quality,
) -> None:
    old = Reading(12.5, "A", quality, at_s=1.0, time_s=NOW_S - 90.0)

    fresh = of_starter(readings={"current": good(12.5, "A")})
    found = of_starter(readings={"current": old, "running": good(True, time_s=NOW_S - 100.0)})

    last_good_s = NOW_S - (90.0 if quality is Quality.STALE else 100.0)
    assert fresh.one("motor_current_amperes") == 12.5
    assert found.all("motor_current_amperes") == []
    assert found.one("starter_last_good_reading_timestamp_seconds") == last_good_s
    assert found.one("starter_last_reply_timestamp_seconds") == NOW_S - 90.0


@pytest.mark.parametrize("family", FAMILIES)
def test_the_unit_of_every_familys_point_can_be_converted(family: str) -> None:
    profile = load_profile(family)
    points = [name for name in MOTOR_POINTS if name in profile.points]

    assert [name for name in points if unit_of(profile, name) not in MOTOR_POINTS[name].factors] == []


def test_a_faults_number_is_there_only_while_there_is_a_fault() -> None:
    number = {"fault_code": good(5)}  # of the last fault, active or not (SSW-07, P014)

    assert of_starter(readings={**number, "fault": good(False)}).all("starter_fault_code") == []
    assert of_starter(readings={**number, "fault": good(True)}).one("starter_fault_code") == 5.0
    assert of_starter(readings={**number, "fault": good(True)}).one("starter_fault_active") == 1.0
    assert of_starter(readings=number).all("starter_fault_active") == []


def test_each_fault_that_the_family_names_has_its_trips_from_0_on_and_another_from_its_first() -> None:
    counted = Counted({"trips_total": {("pump-1", "e05"): 2, ("pump-1", "x99"): 1}}, {})

    found = scrape(starter(), counted=counted)

    trips = {labels["code"]: count for labels, count in found.samples["trips_total"]}
    assert trips == {**dict.fromkeys(fault_codes(load_profile("ssw07")), 0.0), "e05": 2.0, "x99": 1.0}


def test_names_that_hold_quotes_and_newlines_stay_within_their_label() -> None:
    nasty = 'A"} 1\n# x\\'

    found = of_starter(model=nasty)

    assert found.one("starter_info", model=nasty) == 1.0


def test_every_metric_follows_prometheus_naming() -> None:
    for name, spec in SPECS.items():
        assert name.endswith("_total") == (spec.kind == "counter"), name
        assert not set(spec.labels) & {"le", "quantile", "instance", "job"}, name
        assert spec.help.endswith("."), name


def test_no_series_stands_twice_in_a_scrape() -> None:
    found = scrape(starter(), starter("pump-2", address=2))

    lines = [line.rpartition(b" ")[0] for line in found.text.splitlines() if not line.startswith(b"#")]
    assert len(lines) == len(set(lines))
