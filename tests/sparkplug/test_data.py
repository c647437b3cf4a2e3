"""NDATA and DDATA: by exception, together, in order, and never lost in silence."""

from __future__ import annotations

import random

from gateway.records import LockRecord, Quality
from gateway.sparkplug.node import GATHER_S, MOST_CHANGES
from tests.sparkplug.support import EPOCH_S, FACTS, NodeRig, alarm, availability, line, state, value


def test_a_change_goes_out_at_once_and_the_next_ones_of_that_starter_together_a_little_later() -> None:
    rig = NodeRig()
    rig.born()
    rig.say(after_s=1.0)

    rig.put(value("pump", "current", 1.0))
    (first,) = rig.say()
    rig.put(value("pump", "current", 2.0), value("pump", "current", 3.0))
    assert rig.say(after_s=GATHER_S - 0.01) == []
    (second,) = rig.say(after_s=0.01)

    assert [each["value"] for each in first.metrics] == [1.0]
    assert [each["value"] for each in second.metrics] == [2.0, 3.0]


def test_the_changes_of_a_message_are_in_the_order_of_their_times() -> None:
    rig = NodeRig()
    rig.born()
    rig.put(
        value("pump", "current", 2.0, time_s=EPOCH_S + 102.0),
        value("pump", "starts_total", 9, time_s=EPOCH_S + 101.0),
        value("pump", "current", 3.0, time_s=EPOCH_S + 103.0),
    )

    (data,) = rig.say(after_s=1.0)

    times = [EPOCH_S + 101.0, EPOCH_S + 102.0, EPOCH_S + 103.0]
    assert [each["time_ms"] / 1000 for each in data.metrics] == times


def test_what_has_not_changed_is_not_sent_again() -> None:
    rig = NodeRig()
    rig.born()
    rig.put(value("pump", "current", 1.0), state("pump", running=False))
    rig.say(after_s=1.0)

    rig.put(value("pump", "current", 1.0, time_s=EPOCH_S + 99.0), state("pump", running=False))

    assert rig.say(after_s=1.0) == []


def test_a_ddata_has_topic_time_number_and_the_times_of_its_readings_but_no_types() -> None:
    rig = NodeRig()
    rig.born()
    rig.put(value("pump", "current", 1.0))

    (data,) = rig.say(after_s=1.0)

    assert (data.topic, data.qos, data.retain) == ("spBv1.0/plant/DDATA/mcc1/pump", 0, False)
    assert (data.seq, data.time_ms) == (3, round(rig.utc_s * 1000))
    assert [(each["name"], each["type"]) for each in data.metrics] == [("current", None)]
    assert data["current"]["time_ms"] == round((EPOCH_S + 50.0) * 1000)


def test_types_are_named_in_data_where_that_is_configured() -> None:
    rig = NodeRig(has_datatypes=True)
    rig.born()
    rig.put(value("pump", "current", 1.0))

    assert rig.say(after_s=1.0)[0]["current"]["type"] == "Double"


def test_an_ndata_says_what_has_changed_of_the_gateway_and_its_lines() -> None:
    rig = NodeRig()
    rig.born()
    rig.put(line({"utilisation": 0.5, "sweep_s": 1.25}))
    rig.node.note({**FACTS, "outbox/depth": 4}, now_s=rig.now_s, utc_s=rig.utc_s)

    (data,) = rig.say(after_s=1.0)

    assert (data.topic, data.qos, data.retain) == ("spBv1.0/plant/NDATA/mcc1", 0, False)
    assert (data.seq, data.time_ms) == (3, round(rig.utc_s * 1000))
    assert data.values == {"line/hall/utilisation": 0.5, "line/hall/sweep_s": 1.25, "outbox/depth": 4}


def test_no_data_goes_out_before_the_births() -> None:
    rig = NodeRig()
    rig.online()
    rig.put(value("pump", "current", 1.0), line({"utilisation": 0.1, "sweep_s": 1.0}))

    said = rig.say(after_s=1.0)

    assert [each.kind for each in said] == ["NBIRTH", "DBIRTH", "DBIRTH"]
    assert said[1].values["current"] == 1.0


def test_a_value_that_is_stale_or_bad_says_so_and_a_good_one_after_it_too() -> None:
    rig = NodeRig()
    rig.born()
    said = []
    for quality in (Quality.GOOD, Quality.STALE, Quality.BAD, Quality.GOOD):
        rig.put(value("pump", "current", 1.0, quality=quality))
        said += rig.say(after_s=1.0)
    rig.put(value("pump", "current", 2.0))
    said += rig.say(after_s=1.0)

    qualities = [each["current"]["properties"].get("Quality") for each in said]
    assert qualities == [192, 500, 0, 192, None]  # the first was null before


def test_a_flag_that_is_not_known_is_null_and_bad() -> None:
    rig = NodeRig()
    rig.online()
    rig.put(state("pump", running=True))
    rig.say()
    rig.put(state("pump", running=None))

    (data,) = rig.say(after_s=1.0)

    assert (data["running"]["null"], data["running"]["properties"]) == (True, {"Quality": 0})


def test_locks_and_alarms_are_data() -> None:
    rig = NodeRig()
    rig.born()
    rig.put(state("pump", lock=LockRecord("alice", 0.0, "work")), alarm("pump", "e03"))
    (data,) = rig.say(after_s=1.0)
    assert (data.values["locked"], data.values["alarm/code"]) == (True, "e03")

    rig.put(alarm("pump", "e03", is_active=False))

    (data,) = rig.say(after_s=1.0)
    assert (data.values["alarm/active"], data.values["alarm/code"]) == (False, "")


def test_numbers_count_up_by_one_over_all_messages_and_begin_again_after_255() -> None:
    chance = random.Random(4)
    rig = NodeRig()
    said = rig.born()
    for count in range(400):
        starter = chance.choice(("pump", "fan"))
        rig.put(value(starter, "current", float(count)))
        if count % 9 == 0:
            rig.put(availability("fan", chance.choice(("online", "offline")), rig.utc_s))
        if count % 7 == 0:
            rig.node.note({"outbox/depth": count}, now_s=rig.now_s, utc_s=rig.utc_s)
        said += rig.say(after_s=0.3)

    assert {each.kind for each in said} == {"NBIRTH", "DBIRTH", "DDATA", "NDATA", "DDEATH"}
    assert [each.seq for each in said] == [number % 256 for number in range(len(said))]
    assert len(said) > 300


def test_more_changes_than_can_wait_become_a_new_birth_of_everything() -> None:
    rig = NodeRig()
    rig.born()
    for number in range(MOST_CHANGES + 1):
        rig.put(value("pump", "current", float(number)))

    said = rig.say(after_s=1.0)

    assert [(each.kind, each.seq) for each in said] == [("NBIRTH", 0), ("DBIRTH", 1), ("DBIRTH", 2)]
    assert said[1].values["current"] == float(MOST_CHANGES)


def test_a_new_connection_begins_with_births_and_says_nothing_of_before() -> None:
    rig = NodeRig()
    rig.born()
    rig.put(value("pump", "current", 1.0))
    rig.node.end()
    assert rig.say(after_s=5.0) == []
    rig.put(value("pump", "current", 2.0))

    rig.node.begin(8)

    said = rig.say()
    assert [(each.kind, each.seq) for each in said] == [("NBIRTH", 0), ("DBIRTH", 1), ("DBIRTH", 2)]
    assert (said[0].values["bdSeq"], said[1].values["current"]) == (8, 2.0)


def test_the_node_knows_when_it_is_due_so_that_none_looks_in_between() -> None:
    rig = NodeRig()
    rig.born()
    rig.put(value("pump", "current", 1.0))
    rig.say(after_s=1.0)
    assert rig.node.due_s == float("inf")

    rig.put(value("pump", "current", 2.0))

    assert rig.node.due_s == rig.now_s + GATHER_S
