"""Makes docs/reference/asyncapi.yaml, an AsyncAPI 3 file [ASYNCAPI 3.0.0], from the topics."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import yaml

from gateway.contract import CONTRACT_VERSION
from tests.reference.fields import object_schema
from tests.reference.topics import PARAMETERS, TOPICS, Topic

HEAD = "# Made by `make docs` from tests/reference/topics.py, which the tests compare with the program.\n"
BASE = "what all topics begin with: `mqtt.base`, by default starters/ and the gateway's name"
ABOUT = """\
Starter Gateway connects motor soft-starters on RS-485 lines (Modbus RTU) to MQTT; not a safety function.
Times are UTC, RFC 3339 with milliseconds. Floats always have a decimal part. No topic that carries a payload
is a prefix of another."""

DELETED = "deleted"
_DELETED = {
    "title": "Deleted",
    "description": "Empty and retained: the topic is deleted, because its starter, line or alarm is gone.",
    "contentType": "application/octet-stream",
    "payload": {"type": "string", "maxLength": 0},
}


def document() -> dict[str, Any]:
    """Return the file as data."""
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "Starter Gateway",
            "version": f"{CONTRACT_VERSION}.0.0",
            "description": ABOUT,
            "license": {"name": "Apache-2.0"},
        },
        "defaultContentType": "application/json",
        "servers": {
            "broker": {
                "host": "broker.plant:8883",
                "protocol": "secure-mqtt",
                "protocolVersion": "5",
                "description": "Any broker with MQTT 5 or 3.1.1; the contract is complete on 3.1.1.",
            }
        },
        "channels": {topic.name: _channel(topic) for topic in TOPICS},
        "operations": {_verb(topic) + _title(topic): _operation(topic) for topic in TOPICS},
        "components": {"messages": {**{topic.name: _message(topic) for topic in TOPICS}, DELETED: _DELETED}},
    }


def payload_schema(topic: Topic, *, is_closed: bool) -> dict[str, Any]:
    """Return the JSON Schema of a topic's payload; a closed one permits no field that it does not name."""
    return {"type": "object", **object_schema(topic.fields, extra=topic.extra, is_closed=is_closed)}


def page() -> str:
    """Return the file as text."""
    return HEAD + yaml.dump(document(), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)


class _Dumper(yaml.SafeDumper):
    """Writes everything out, since not every reader of AsyncAPI files knows anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _channel(topic: Topic) -> Mapping[str, Any]:
    names = ["base", *re.findall(r"{(\w+)}", topic.address)]
    about = {"base": BASE, **PARAMETERS}
    return {
        "address": f"{{base}}/{topic.address}",
        "description": topic.meaning,
        "parameters": {name: {"description": about[name]} for name in names},
        "messages": {name: {"$ref": f"#/components/messages/{name}"} for name in _messages_of(topic)},
    }


def _operation(topic: Topic) -> Mapping[str, Any]:
    return {
        "action": _verb(topic),
        "channel": {"$ref": f"#/channels/{topic.name}"},
        "bindings": {"mqtt": {"qos": topic.qos, "retain": topic.is_retained, "bindingVersion": "0.2.0"}},
        "messages": [{"$ref": f"#/channels/{topic.name}/messages/{name}"} for name in _messages_of(topic)],
    }


def _message(topic: Topic) -> Mapping[str, Any]:
    schema = payload_schema(topic, is_closed=topic.is_received)  # fields may be added to all that is sent
    return {"title": _title(topic), "contentType": "application/json", "payload": schema}


def _messages_of(topic: Topic) -> tuple[str, ...]:
    return (topic.name, DELETED) if topic.is_deletable else (topic.name,)


def _verb(topic: Topic) -> str:
    return "receive" if topic.is_received else "send"


def _title(topic: Topic) -> str:
    return topic.name[0].upper() + topic.name[1:]
