"""NBIRTH and DBIRTH: what they name, and when."""

from __future__ import annotations

from gateway.records import Quality
from tests.sparkplug.support import (
    EPOCH_S,
    FACTS,
    POINTS,
    PROPERTIES,
    SINCE_S,
    NodeRig,
    alarm,
    availability,
    info,
    line,
    state,
    value,
)


def test_the_first_message_of_a_connection_is_the_nbirth_with_seq_0() -> None:
    rig = NodeRig()
    rig.online()
    rig.put(value("pump", "current", 1.0))

    first, *others = rig.say()

    assert (first.kind, first.topic, first.seq) == ("NBIRTH", "spBv1.0/plant/NBIRTH/mcc1", 0)
    assert (first.qos, first.retain) == (0, False)
    assert [each.kind for each in others] == ["DBIRTH", "DBIRTH"]


def test_an_nbirth_carries_its_time_and_the_number_of_the_will() -> None:
    rig = NodeRig()

    (birth,) = rig.say()

    assert birth.time_ms == round(rig.utc_s * 1000)
    assert (birth["bdSeq"]["type"], birth["bdSeq"]["value"]) == ("Int64", 7)


def test_an_nbirth_names_every_metric_that_the_node_ever_sends_with_type_and_value() -> None:
    rig = NodeRig()
    rig.put(line({"utilisation": 0.5, "sweep_s": 1.25}))

    (birth,) = rig.say()

    lines = {"line/hall/utilisation": 0.5, "line/hall/sweep_s": 1.25}
    assert birth.values == {"bdSeq": 7, "Node Control/Rebirth": False, **PROPERTIES, **FACTS, **lines}
    assert all(each["type"] for each in birth.metrics)


def test_an_nbirth_offers_the_rebirth_as_a_boolean_that_is_false() -> None:
    (birth,) = NodeRig().say()
    rebirth = birth["Node Control/Rebirth"]

    assert (rebirth["type"], rebirth["value"], rebirth["alias"]) == ("Boolean", False, False)


def test_every_metric_has_its_name_and_no_alias() -> None:
    rig = NodeRig(operator="scada")
    births = rig.born()
    rig.put(value("pump", "current", 1.0))

    metrics = [metric for each in [*births, *rig.say()] for metric in each.metrics]
    assert all(metric["name"] and not metric["alias"] for metric in metrics)


def test_a_dbirth_names_every_metric_that_its_starter_ever_sends_with_type_and_time() -> None:
    rig = NodeRig()
    rig.put(info("pump"), value("pump", "current", 12.5), state("pump", running=True))
    rig.put(availability("pump", "online", rig.utc_s))

    birth = rig.say()[-1]

    own = {"state", "availability", "reason", "locked"}
    assert POINTS.keys() | own <= set(birth.names)
    assert all(each["type"] and each["time_ms"] for each in birth.metrics)
    assert (birth.values["current"], birth.values["state"], birth.values["running"]) == (12.5, "ready", True)
    assert birth.values["Properties/Hardware Make"] == "WEG"
    assert birth.values["Properties/Serial"] == "77"


def test_a_dbirth_follows_the_nbirth_with_the_next_number_on_its_starters_topic() -> None:
    rig = NodeRig()

    node, pump, fan = rig.born()

    assert (pump.topic, fan.topic) == ("spBv1.0/plant/DBIRTH/mcc1/pump", "spBv1.0/plant/DBIRTH/mcc1/fan")
    assert [each.seq for each in (node, pump, fan)] == [0, 1, 2]
    assert {(each.qos, each.retain) for each in (pump, fan)} == {(0, False)}
    assert pump.time_ms == round(rig.utc_s * 1000)


def test_a_starter_that_has_never_answered_has_no_birth_and_one_that_begins_to_answer_is_born() -> None:
    rig = NodeRig()
    rig.put(info("pump"), availability("pump", "offline", rig.utc_s, "not yet read"))
    assert [each.kind for each in rig.say()] == ["NBIRTH"]

    rig.put(availability("pump", "online", rig.utc_s))

    assert [(each.kind, each.seq) for each in rig.say()] == [("DBIRTH", 1)]


def test_what_was_never_read_is_null_and_bad_with_its_type() -> None:
    rig = NodeRig()
    rig.put(value("pump", "current", None, quality=Quality.BAD, time_s=None))

    metric = rig.born()[1]["current"]

    assert (metric["null"], metric["type"], metric["properties"]["Quality"]) == (True, "Double", 0)


def test_what_is_not_known_at_the_birth_is_dated_before_what_is_read_around_it() -> None:
    rig = NodeRig(operator="scada")
    birth = rig.born()[1]
    assert {each["time_ms"] for each in birth.metrics if each["null"]} == {round(SINCE_S * 1000)}

    rig.put(value("pump", "current", 1.5, time_s=rig.utc_s - 0.1), state("pump", running=True))

    (data,) = rig.say(after_s=1.0)
    assert set(data.names) >= {"current", "running", "state"}
    assert all(birth[each["name"]]["time_ms"] < each["time_ms"] for each in data.metrics)


def test_a_birth_offers_the_commands_that_the_operator_has_the_right_to_and_the_family_knows() -> None:
    def offered(*may: str) -> list[set[str]]:
        births = [set(each.names) for each in NodeRig(operator="scada", may=may).born()[1:]]
        return [{each.removeprefix("Command/") for each in names if "mand/" in each} for names in births]

    last = {f"Last/{each}" for each in ("Verb", "Id", "Phase", "Code", "Text")}
    assert offered("*") == [{"Stop", "Start", "Reset"} | last, last]
    assert offered("stop", "reset", "lock") == [{"Stop", "Reset"} | last, last]


def test_a_birth_says_units_and_names() -> None:
    properties = NodeRig().born()[1]["current"]["properties"]

    assert (properties["engUnit"], properties["Documentation"]) == ("A", "Motor current")


def test_the_metrics_of_a_birth_are_in_the_order_of_their_times() -> None:
    rig = NodeRig()
    rig.online()
    rig.put(
        value("pump", "current", 1.0, time_s=EPOCH_S + 70.0),
        value("pump", "starts_total", 3, time_s=EPOCH_S + 30.0),
        line({"utilisation": 0.5, "sweep_s": 1.25}),
    )

    for birth in rig.say():
        times = [each["time_ms"] for each in birth.metrics]
        assert times == sorted(times)
    assert birth is not None


def test_another_set_of_points_is_named_by_a_new_dbirth_before_any_data() -> None:
    rig = NodeRig()
    rig.born()
    more = {**POINTS, "power": {"type": "float", "unit": "kW", "name": "Power"}}

    rig.put(info("pump", points=more), value("pump", "power", 5.0))

    (birth,) = rig.say()
    assert (birth.kind, birth.values["power"]) == ("DBIRTH", 5.0)


def test_a_point_that_no_birth_has_named_is_never_sent() -> None:
    rig = NodeRig()
    rig.born()

    rig.put(value("pump", "unheard_of", 5.0))

    assert rig.say(after_s=1.0) == []


def test_another_machine_of_the_same_name_inherits_no_value() -> None:
    rig = NodeRig()
    rig.online()
    rig.put(value("pump", "current", 12.5), alarm("pump", "e03"))
    rig.say()

    rig.put(info("pump", address=9), availability("pump", "offline", rig.utc_s))
    rig.put(availability("pump", "online", rig.utc_s))

    death, birth = rig.say()
    assert (death.kind, birth.kind, birth["current"]["null"]) == ("DDEATH", "DBIRTH", True)
    assert birth["current"]["time_ms"] == round(rig.utc_s * 1000)  # after what the other one has said
    assert birth.values["alarm/active"] is False


def test_further_starters_and_lines_are_born_after_a_reload() -> None:
    rig = NodeRig()
    rig.born()

    rig.node.move(("pump", "fan", "mill"))
    rig.node.move_lines(("hall", "yard"))
    rig.put(info("mill"), availability("mill", "online", rig.utc_s))

    said = rig.say()
    assert [(each.kind, each.device) for each in said] == [
        ("NBIRTH", None),
        ("DBIRTH", "pump"),
        ("DBIRTH", "fan"),
        ("DBIRTH", "mill"),
    ]
    assert "line/yard/sweep_s" in said[0].names


def test_faults_and_alarms_show_the_latest_fault_first() -> None:
    rig = NodeRig()
    rig.online()
    rig.put(alarm("pump", "e03"), alarm("pump", "a10", severity="alarm"))

    values = rig.say()[1].values

    assert (values["alarm/active"], values["alarm/count"], values["alarm/code"]) == (True, 2, "e03")
    assert values["alarm/text"] == "text of e03"
