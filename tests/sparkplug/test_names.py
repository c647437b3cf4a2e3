"""Names and topics of an edge node."""

from __future__ import annotations

import pytest
from pydantic import TypeAdapter, ValidationError

from gateway.config.values import Name, SparkplugId
from gateway.sparkplug.topics import EdgeTopics, state_topic
from tests.sparkplug.support import NodeRig, availability, info, value


def test_every_topic_is_namespace_group_kind_node_and_for_devices_the_starter() -> None:
    topics = EdgeTopics("plant", "mcc1")

    assert topics.of("NBIRTH") == "spBv1.0/plant/NBIRTH/mcc1"
    assert topics.of("DDATA", "pump") == "spBv1.0/plant/DDATA/mcc1/pump"
    assert topics.device_commands == "spBv1.0/plant/DCMD/mcc1/+"
    assert state_topic("scada") == "spBv1.0/STATE/scada"


def test_messages_of_the_node_name_no_device_and_those_of_a_device_name_it() -> None:
    rig = NodeRig()
    births = rig.born()
    rig.put(value("pump", "current", 1.0), availability("fan", "offline", rig.utc_s))
    rig.node.note({"outbox/depth": 3}, now_s=rig.now_s, utc_s=rig.utc_s)

    said = [*births, *rig.say(after_s=1.0)]

    assert {each.kind for each in said} == {"NBIRTH", "NDATA", "DBIRTH", "DDATA", "DDEATH"}
    assert all((each.device is None) == (each.kind[0] == "N") for each in said)
    assert all(each.topic.startswith("spBv1.0/plant/") for each in said)


def test_a_device_has_the_name_of_its_starter_which_is_unique_in_the_configuration() -> None:
    births = [each for each in NodeRig().born() if each.kind == "DBIRTH"]

    assert [each.device for each in births] == ["pump", "fan"]


@pytest.mark.parametrize("text", ["a+b", "a/b", "#", "", "a\n", "a\x00b"])
def test_reserved_signs_are_refused_in_ids(text: str) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(SparkplugId).validate_python(text)
    with pytest.raises(ValidationError):
        TypeAdapter(Name).validate_python(text)


def test_names_of_starters_are_lower_case_so_none_differs_by_case_alone() -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Name).validate_python("Pump")


def test_no_two_metrics_differ_by_case_alone() -> None:
    for each in NodeRig(operator="scada").born():
        assert len({name.lower() for name in each.names}) == len(each.names)


def test_a_command_topic_of_another_node_or_with_more_levels_names_no_device() -> None:
    topics = EdgeTopics("plant", "mcc1")

    assert topics.commanded_device("spBv1.0/plant/DCMD/mcc1/pump") == "pump"
    for other in (
        "spBv1.0/plant/DCMD/mcc2/pump",
        "spBv1.0/plant/DCMD/mcc1/pump/x",
        "spBv1.0/plant/DCMD/mcc1/",
    ):
        assert topics.commanded_device(f"spBv1.0/plant/DCMD/{other}") is None


def test_an_info_of_no_configured_starter_makes_no_device() -> None:
    rig = NodeRig()
    rig.put(info("other"), availability("other", "online", rig.utc_s))

    assert [each.kind for each in rig.say()] == ["NBIRTH"]
