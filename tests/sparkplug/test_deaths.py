"""DDEATH and NDEATH."""

from __future__ import annotations

from tests.sparkplug.support import NodeRig, availability, read, value


def test_a_starter_that_falls_silent_dies_and_one_that_answers_again_is_born_again() -> None:
    rig = NodeRig()
    rig.born()

    rig.put(availability("pump", "offline", rig.utc_s, "no reply"))
    (death,) = rig.say()
    rig.put(availability("pump", "degraded", rig.utc_s, "P3 refused"))
    (birth,) = rig.say()

    assert (death.kind, death.topic) == ("DDEATH", "spBv1.0/plant/DDEATH/mcc1/pump")
    assert (death.qos, death.retain, death.seq, death.metrics) == (0, False, 3, [])
    assert death.time_ms == round(rig.utc_s * 1000)
    assert (birth.kind, birth.seq, birth.values["reason"]) == ("DBIRTH", 4, "P3 refused")


def test_after_its_death_nothing_of_a_starter_is_sent() -> None:
    rig = NodeRig()
    rig.born()
    rig.put(availability("pump", "offline", rig.utc_s), value("pump", "current", 9.0))

    assert [each.kind for each in rig.say(after_s=1.0)] == ["DDEATH"]


def test_what_a_starter_still_had_to_say_goes_out_before_its_death() -> None:
    rig = NodeRig()
    rig.born()
    rig.put(value("pump", "current", 9.0), availability("pump", "offline", rig.utc_s))

    said = rig.say()

    assert [each.kind for each in said] == ["DDATA", "DDEATH"]
    assert said[0].values == {"current": 9.0}


def test_a_starter_that_is_gone_and_back_before_anything_was_written_dies_and_is_born() -> None:
    rig = NodeRig()
    rig.born()
    rig.put(availability("pump", "offline", rig.utc_s), availability("pump", "online", rig.utc_s))

    assert [each.kind for each in rig.say()] == ["DDEATH", "DBIRTH"]


def test_a_starter_that_is_configured_no_more_dies() -> None:
    rig = NodeRig()
    rig.born()
    rig.put(value("fan", "current", 9.0))

    rig.node.move(("pump",))

    assert [(each.kind, each.device) for each in rig.say(after_s=1.0)] == [("DDEATH", "fan")]
    assert rig.say(after_s=1.0) == []


def test_a_starter_that_was_never_born_does_not_die() -> None:
    rig = NodeRig()
    rig.say()
    rig.put(availability("pump", "offline", rig.utc_s))

    assert rig.say() == []


def test_the_will_is_an_ndeath_with_its_number_alone_qos_1_and_not_retained() -> None:
    rig = NodeRig()

    death = read(rig.node.death(7, rig.utc_s))

    assert death.topic == "spBv1.0/plant/NDEATH/mcc1"
    assert (death.qos, death.retain, death.seq) == (1, False, None)
    assert [(each["name"], each["type"], each["value"]) for each in death.metrics] == [("bdSeq", "Int64", 7)]
