"""What deploy/contrib has for programs that CI does not run agrees with ours: topics, types, rights."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from paho.mqtt.client import topic_matches_sub

from gateway.cli.broker_kit.logins import access_list, logins_of
from gateway.cli.broker_kit.settings import KitSettings
from gateway.contract import (
    AlarmRecord,
    AuditRecord,
    EventRecord,
    HistoryRecord,
    ResultRecord,
    StartRecord,
    StateRecord,
    Topics,
    TripRecord,
    ValueRecord,
)
from tests.config.sites import site

DEPLOY = Path(__file__).parents[2] / "deploy"
CONTRIB = DEPLOY / "contrib"
TELEGRAF = tomllib.loads((CONTRIB / "telegraf" / "telegraf.conf").read_text("utf-8"))
INPUTS = TELEGRAF["inputs"]["mqtt_consumer"]
TOPICS = Topics("starters/mcc1")
PUBLISHED = [
    TOPICS.of(ValueRecord, starter="pump-1", point="current"),
    TOPICS.of(StateRecord, starter="pump-1"),
    TOPICS.of(AlarmRecord, starter="pump-1", code="f072"),
    TOPICS.of(EventRecord, starter="pump-1"),
    TOPICS.of(StartRecord, starter="pump-1"),
    TOPICS.of(TripRecord, starter="pump-1"),
    TOPICS.of(HistoryRecord, starter="pump-1"),
    "starters/mcc1/gateway/event",
    TOPICS.of(AuditRecord),
    TOPICS.of(ResultRecord, starter="pump-1", client="alice"),
]


@pytest.mark.parametrize("block", INPUTS, ids=lambda block: block["client_id"])
def test_each_input_of_telegraf_reads_one_of_our_topics_and_names_its_levels(block: dict[str, Any]) -> None:
    (topic,), (parsing,) = block["topics"], block["topic_parsing"]

    assert [published for published in PUBLISHED if topic_matches_sub(topic, published)]
    assert parsing["topic"] == topic
    names = dict(zip(parsing["tags"].split("/"), topic.split("/"), strict=True))
    assert {name for name in names if names[name] == "+"} == names.keys() - {"_"}
    assert (block["qos"], block["persistent_session"], block["client_id"]) == (1, True, block["username"])


def test_telegraf_gets_one_field_for_each_type_of_value() -> None:
    (processor,) = TELEGRAF["processors"]["starlark"]
    scope: dict[str, Any] = {
        "type": lambda value: {"str": "string"}.get(type(value).__name__, type(value).__name__)
    }
    exec(processor["source"], scope)  # Starlark is nearly Python

    def fields(value: object) -> dict[str, object]:
        metric = SimpleNamespace(fields={"value": value, "seq": 7})
        return dict(scope["apply"](metric).fields)

    assert fields(12.0) == {"seq": 7, "number": 12.0}
    assert fields(True) == {"seq": 7, "flag": True}
    assert fields("ramp") == {"seq": 7, "text": "ramp"}
    assert fields(3) == {"seq": 7, "number": 3.0}
    assert fields(None) == {"seq": 7}


def test_the_rules_of_emqx_take_all_that_the_tables_hold() -> None:
    rules = (CONTRIB / "emqx" / "rules.sql").read_text("utf-8")

    filters = re.findall(r'"(starters/[^"]+)"', rules)
    assert [topic for topic in PUBLISHED if not any(topic_matches_sub(each, topic) for each in filters)] == []
    assert [each for each in filters if not any(topic_matches_sub(each, topic) for topic in PUBLISHED)] == []


def rights(lines: list[str]) -> Iterator[tuple[str, str, str]]:
    """Yield user, read or write, and topic of a list of Mosquitto's."""
    user = ""
    for line in lines:
        match line.split():
            case ["user", name]:
                user = name
            case ["topic", right, topic]:
                yield user, right, topic


def test_the_list_for_emqx_gives_the_rights_of_the_one_for_mosquitto() -> None:
    text = (CONTRIB / "emqx" / "acl.conf").read_text("utf-8")
    given = set()
    for who, action, topics in re.findall(
        r"^\{allow, \{username, (.*?)\}, (\w+), \[(.*)\]\}\.$", text, re.MULTILINE
    ):
        for user in re.findall(r"\w+", who.removeprefix("{re")):
            right = {"subscribe": "read", "publish": "write"}[action]
            given |= {
                (user, right, topic.replace("${username}", user))
                for topic in re.findall(r'"([^"]+)"', topics)
            }

    logins = ('url = "mqtts://broker.plant:8883"', 'url = "mqtts://broker.plant:8883"\nusername = "mcc1"')
    bob = (
        'client = "alice"',
        'client = "bob"\nmay = ["stop"]\nstarters = ["*"]\n\n[[operator]]\nclient = "alice"',
    )
    ours = access_list(logins_of(site(logins, bob), KitSettings()))
    wanted = set(rights(ours.splitlines()))
    besides = set(rights((CONTRIB / "postgresql" / "README.md").read_text("utf-8").splitlines()))
    others = {each for each in given | wanted | besides if each[0] in ("auditor", "historian")}
    assert given - others == wanted - others
    assert {topic for user, _, topic in given if user == "historian"} >= {"starters/mcc1/audit"}
    assert text.rstrip().endswith("{deny, all}.")


def test_the_consumers_login_may_read_what_it_subscribes_to() -> None:
    lines = (CONTRIB / "postgresql" / "README.md").read_text("utf-8").splitlines()
    allowed = [topic for _, _, topic in rights(lines)]

    assert [each for each in PUBLISHED if not any(topic_matches_sub(may, each) for may in allowed)] == []
