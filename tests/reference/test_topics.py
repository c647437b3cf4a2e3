"""What a plant publishes is as docs/reference/topics.md says, and what the page names is published."""

from __future__ import annotations

import inspect
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping

import pytest
from jsonschema import Draft7Validator

from gateway.mqtt.contract import commands
from gateway.contract import Topics
from tests.reference.asyncapi import payload_schema
from tests.reference.event_codes import EVENTS
from tests.reference.fields import Field
from tests.reference.topics import TOPICS, Topic
from tests.rig import MqttMessage, RigPlant, act, command, fault
from tests.rig.sites import ALICE, FOUR, QUICK, table

BY_NAME = {topic.name: topic for topic in TOPICS}
LISTED = {code: event for events in EVENTS.values() for code, event in events.items()}
LOOSE = {"command", "result"}  # whose fields depend on the verb
RARE = {  # what this day does not have
    "lineStatistics": {"uart_errors"},  # of a real port
    "starterValue": {"reason"},
    "starterStart": {"drift", "lowest_v", "outliers"},
    "starterTrip": {"thinned"},
    "audit": {"source"},  # of another way in than MQTT
}
DAY = {
    3.0: command("pump/alice/lock", args={"reason": "bearing"}, operator="Anna"),
    5.0: command("pump/alice/unlock"),
    6.0: command("pump/alice/start"),
    9.0: command("pump/alice/read", args={"parameter": "P220"}),
    10.0: "broker down",
    12.0: "pump trip E05",
    14.0: fault("silent", "fan", for_s=40.0),
    60.0: "broker up",
    75.0: "pump clear",
    80.0: command("hall/alice/stop"),
    90.0: command("pump/bob/start"),
    100.0: "end",
}


@pytest.fixture(scope="module")
def published() -> Mapping[str, list[MqttMessage]]:
    """Return all messages of a day, by the name of their topic."""
    found: dict[str, list[MqttMessage]] = defaultdict(list)
    hall = table("[group]", name="hall", starters=["pump", "fan"])
    with RigPlant(FOUR + ALICE + hall, sim={"pump": QUICK}) as plant:
        for at_s, action in DAY.items():
            plant.run(until=at_s)
            act(plant, action)
        for message in plant.messages():
            if message.payload:
                found[_name_of(message.topic.removeprefix(f"{plant.base}/"))].append(message)
    return found


def _name_of(address: str) -> str:
    (name,) = (
        topic.name
        for topic in TOPICS
        if re.fullmatch(re.sub(r"\\{\w+\\}", "[a-z0-9_-]+", re.escape(topic.address)), address)
    )
    return name


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_what_is_published_has_all_fields_that_the_page_says_and_no_others(
    topic: Topic, published: Mapping[str, list[MqttMessage]]
) -> None:
    messages = published[topic.name]
    wrong = list(_problems(topic, messages))
    fields = set().union(*(message.json for message in messages if message.json))

    assert messages
    assert wrong[:5] == []
    if topic.name not in LOOSE:
        assert set(topic.fields) - fields == RARE.get(topic.name, set())


def _problems(topic: Topic, messages: list[MqttMessage]) -> Iterator[str]:
    validator = Draft7Validator(payload_schema(topic, is_closed=True))
    for message in messages:
        for error in validator.iter_errors(message.json):
            yield f"{'.'.join(map(str, error.path))}: {error.message}"
        if (message.qos, message.retain) != (topic.qos, topic.is_retained):
            yield f"qos {message.qos}, retain {message.retain}"


@pytest.mark.parametrize("name", ["starterEvent", "gatewayEvent"])
def test_events_have_the_severity_and_data_that_the_list_says(
    name: str, published: Mapping[str, list[MqttMessage]]
) -> None:
    for event in (message.json for message in published[name]):
        listed = LISTED[event["code"]]
        assert event["severity"] in {each.value for each in listed.severities}
        assert set(event.get("data") or ()) <= set(listed.fields), event


def test_the_page_has_every_topic_of_the_contract_and_no_others() -> None:
    topics = Topics("b")
    fixed = {value for name, value in vars(topics).items() if name.startswith(("gateway_", "audit"))}
    built = {
        method(topics, *list(inspect.signature(method).parameters)[1:])
        for name, method in inspect.getmembers(Topics, inspect.isfunction)
        if not name.startswith(("_", "parse_")) and name != "starter"
    }

    assert fixed | built == {f"b/{topic.address}".translate({ord(c): "" for c in "{}"}) for topic in TOPICS}


def test_a_command_may_have_the_fields_that_the_page_says_and_no_others() -> None:
    assert set(BY_NAME["command"].fields) == set(commands._Body.model_fields)


def described(fields: Mapping[str, Field], path: str = "") -> list[str]:
    bare = [f"{path}{name}" for name, field in fields.items() if not field.meaning]
    return bare + [
        each for name, field in fields.items() for each in described(field.inside, f"{path}{name}.")
    ]


def test_every_field_has_a_meaning_and_a_number_of_seconds_its_unit() -> None:
    for topic in TOPICS:
        assert described(topic.fields) == []
        assert {field.unit for name, field in topic.fields.items() if name.endswith("_s")} <= {"s", ""}
