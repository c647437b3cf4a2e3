"""What a plant publishes is as docs/reference/topics.md says, and what the page names is published."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import Any

import pytest
from jsonschema import Draft7Validator

from gateway import contract
from gateway.contract import (
    CommandBody,
    EventRecord,
    HistoryRecord,
    Record,
    read_record,
)
from gateway.contract.events import EVENTS
from tests.reference.contract_pages import TOPICS, Topic, closed
from tests.rig import MqttMessage, RigPlant, act, command, fault
from tests.rig.sites import ALICE, FOUR, QUICK, table

LOOSE = {"command", "result"}  # whose fields depend on the verb
READABLE = [topic for topic in TOPICS if topic.kind not in (None, EventRecord, HistoryRecord)]
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
        assert set(topic.schema["properties"]) - fields == RARE.get(topic.name, set())


def _problems(topic: Topic, messages: list[MqttMessage]) -> Iterator[str]:
    validator = Draft7Validator(closed(topic.schema))
    for message in messages:
        for error in validator.iter_errors(message.json):
            yield f"{'.'.join(map(str, error.path))}: {error.message}"
        if (message.qos, message.retain) != topic.delivery:
            yield f"qos {message.qos}, retain {message.retain}"


@pytest.mark.parametrize("topic", READABLE, ids=lambda topic: topic.name)
def test_a_record_is_read_as_it_was_written(topic: Topic, published: Mapping[str, list[MqttMessage]]) -> None:
    address = re.compile(".*/" + re.sub(r"{(\w+)}", r"(?P<\1>[a-z0-9_-]+)", topic.address))
    for message in published[topic.name]:
        found = address.fullmatch(message.topic)
        assert topic.kind
        assert found
        assert read_record(topic.kind, message.payload, **found.groupdict()).payload() == message.payload


@pytest.mark.parametrize("name", ["starterEvent", "gatewayEvent"])
def test_events_have_the_severity_and_data_that_the_list_says(
    name: str, published: Mapping[str, list[MqttMessage]]
) -> None:
    for event in (message.json for message in published[name]):
        listed = EVENTS[event["code"]]
        assert event["severity"] in {each.value for each in listed.severities}
        assert set(event.get("data") or ()) <= set(listed.data), event


def test_the_page_has_every_record_of_the_contract_that_is_published() -> None:
    found = {each for each in vars(contract).values() if isinstance(each, type) and issubclass(each, Record)}

    assert {topic.kind for topic in TOPICS} - {None} == {each for each in found if getattr(each, "TOPIC", "")}


def test_a_command_may_have_the_fields_that_the_page_says_and_no_others() -> None:
    (page,) = (topic.schema for topic in TOPICS if topic.name == "command")

    assert page["properties"].keys() == CommandBody.model_fields.keys()


def parts(schema: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the fields of a schema, with all that they contain."""
    for name, each in schema.get("properties", {}).items():
        yield f"{path}{name}", each
        yield from parts(each, f"{path}{name}.")
    for name in ("items", "additionalProperties"):
        if name in schema:
            yield from parts(schema[name], path)


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_every_field_has_a_meaning_and_a_number_of_seconds_its_unit(topic: Topic) -> None:
    fields = dict(parts(topic.schema))

    assert [path for path, each in fields.items() if not each.get("description")] == []
    seconds = {path: each for path, each in fields.items() if path.endswith("_s")}
    numbers = {path: each["description"] for path, each in seconds.items() if "number" in each["type"]}
    assert {path: text for path, text in numbers.items() if ", s" not in text} == {}
