"""Every message of a node over two minutes: topic, number, time, names, types, qualities."""

from __future__ import annotations

import re
from itertools import pairwise

import pytest

from tests.rig.sparkplug import BOOLEAN, DOUBLE, INT32, INT64, STRING
from tests.sparkplug.plant import REBIRTH_S, connected, said, said_of

OF_DEVICES = "DBIRTH", "DDATA", "DDEATH"
NUMBERED = "NBIRTH", "NDATA", *OF_DEVICES
TOPIC = re.compile(r"spBv1\.0/plant/(N(BIRTH|DATA|DEATH)/plant|D(BIRTH|DATA|DEATH)/plant/(pump|fan))")


def test_every_topic_is_namespace_group_kind_node_and_for_devices_the_starter() -> None:
    assert {each.kind for each in said()} == {*NUMBERED, "NDEATH"}
    assert [each.topic for each in said() if not TOPIC.fullmatch(each.topic)] == []


def test_births_data_and_deaths_of_devices_are_qos_0_and_nothing_is_retained() -> None:
    assert {(each.qos, each.retain) for each in said_of(*NUMBERED)} == {(0, False)}


@pytest.mark.parametrize("speaks_5", [True, False])
def test_a_connect_is_clean_with_an_ndeath_as_its_will_that_has_the_births_number_alone(
    *, speaks_5: bool
) -> None:
    will, birth, is_clean = connected(speaks_5=speaks_5)

    assert is_clean
    assert (will.topic, will.qos, will.retain, will.seq) == ("spBv1.0/plant/NDEATH/plant", 1, False, None)
    assert [(each.name, each.kind) for each in will.metrics] == [("bdSeq", INT64)]
    assert will.values["bdSeq"] == birth.values["bdSeq"]


def test_numbers_count_up_by_one_from_the_nbirth_on_and_begin_again_after_255() -> None:
    numbers: list[list[int | None]] = []
    for each in said_of(*NUMBERED):
        if each.kind == "NBIRTH":
            numbers.append([])
        numbers[-1].append(each.seq)

    assert len(numbers) == 2
    assert len(numbers[0]) > 256
    assert all(found == [number % 256 for number in range(len(found))] for found in numbers)


def test_a_message_has_the_time_at_which_it_is_sent_and_each_metric_that_of_its_reading() -> None:
    for each in said_of(*NUMBERED):
        times = [metric.time_ms or 0 for metric in each.metrics]
        assert each.time_ms == pytest.approx(each.sent_ms, abs=300)
        assert times == sorted(times)
        assert all(each.sent_ms - 150_000 < time_ms <= each.sent_ms + 1 for time_ms in times)


def test_a_birth_names_every_metric_that_is_ever_sent_with_its_type_and_data_names_no_type() -> None:
    named: dict[str | None, set[str]] = {}
    for each in said_of("NBIRTH", "DBIRTH", "NDATA", "DDATA"):
        names = [metric.name for metric in each.metrics]
        if "BIRTH" in each.kind:
            named[each.device] = set(names)
            assert len({name.lower() for name in names}) == len(names), "none differs by case alone"
            assert {metric.kind for metric in each.metrics} <= {INT32, INT64, DOUBLE, BOOLEAN, STRING}
        else:
            assert {metric.kind for metric in each.metrics} == {None}
        assert all(names)
        assert set(names) <= named[each.device]
        assert not any(metric.has_alias for metric in each.metrics)


def test_an_nbirth_comes_first_and_offers_the_rebirth_as_a_boolean_that_is_false() -> None:
    first, *others = said()[:3]

    assert (first.kind, first.seq) == ("NBIRTH", 0)
    assert (first["Node Control/Rebirth"].kind, first.values["Node Control/Rebirth"]) == (BOOLEAN, False)
    assert (first["bdSeq"].kind, first.values["bdSeq"]) == (INT64, 0)
    assert {(each.kind, each.device) for each in others} == {("DBIRTH", "pump"), ("DBIRTH", "fan")}


def test_what_is_not_known_is_null_and_bad_and_what_becomes_good_again_says_so() -> None:
    birth = said_of("DBIRTH")[0]
    unknown = [each for each in birth.metrics if each.is_null]
    assert {each.properties["Quality"] for each in unknown} == {0}
    assert birth["current"].properties == {"engUnit": "A", "Documentation": "motor current", "Quality": 0}

    qualities: dict[str, int] = {}
    seen = set()
    for each in said_of("DBIRTH", "DDATA"):
        for metric in each.metrics:
            before = qualities.get(f"{each.device} {metric.name}", 192)
            quality = metric.properties.get("Quality", 192)
            is_said = "Quality" in metric.properties
            assert is_said or before == 192, f"{metric.name} is good again and does not say so"
            qualities[f"{each.device} {metric.name}"] = quality
            seen.add(quality)
    assert seen == {0, 192, 500}


def test_properties_have_as_many_keys_as_values_each_with_its_type() -> None:
    for each in said():
        for metric in each.metrics:
            types = {key: INT32 if key == "Quality" else STRING for key in metric.properties}
            assert metric.property_types == types


def test_what_has_not_changed_is_not_sent_again() -> None:
    known: dict[tuple[str | None, str], tuple[object, ...]] = {}
    for each in said_of("NBIRTH", "DBIRTH", "NDATA", "DDATA"):
        for metric in each.metrics:
            found = metric.value, metric.is_null, metric.properties.get("Quality", 192)
            assert "BIRTH" in each.kind or known.get((each.device, metric.name)) != found, metric
            known[each.device, metric.name] = found


def test_a_device_that_dies_says_nothing_until_it_is_born_again() -> None:
    kinds = [each.kind for each in said() if each.device == "fan"]
    after = [later for before, later in pairwise(kinds) if before == "DDEATH"]

    assert set(after) == {"DBIRTH"}
    assert {len(each.metrics) for each in said_of("DDEATH")} == {0}


def test_no_data_is_sent_between_a_request_and_its_births() -> None:
    asked_ms = said()[0].sent_ms - 100 + 1000 * REBIRTH_S
    kinds = [each.kind for each in said() if each.sent_ms >= asked_ms]

    assert kinds[:4] == ["NBIRTH", "DBIRTH", "DBIRTH", "DDATA"]


def test_an_ndata_says_what_has_changed_of_the_gateway_and_its_lines() -> None:
    names = {name for each in said_of("NDATA") for name in each.values}

    assert {"line/pumps/utilisation", "line/pumps/sweep_s", "gateway/status"} <= names


def test_locks_and_alarms_are_data() -> None:
    locked = [each.values["locked"] for each in said_of("DDATA") if "locked" in each.values]
    codes = [each.values["alarm/code"] for each in said_of("DDATA") if "alarm/code" in each.values]

    assert locked == [True]
    assert codes == ["fault"]
