"""Makes docs/reference/topics.md and asyncapi.yaml (AsyncAPI 3 [ASYNCAPI 3.0.0]) from the contract."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import yaml
from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core.core_schema import DataclassField, ModelField, TypedDictField

from gateway import contract
from gateway.contract import CONTRACT_VERSION, CommandBody, Record
from tests.reference.markdown import table

MADE = "Made by `make docs` from gateway/contract, which the tests compare with a run."
HEAD = f"""\
# Topics and payloads

<!-- {MADE} -->

`B` is `mqtt.base`, by default `starters/` and the gateway's name.
The same for programs: [asyncapi.yaml](asyncapi.yaml) (AsyncAPI 3).

- No topic that carries a payload is a prefix of another.
- Every level is made of `a-z`, `0-9`, `_` and `-`, those of `B` too; `B` may have any number of them.
- Times are UTC, RFC 3339 with milliseconds.
- Numbers that may have decimals always have some; there is no NaN.
- A field may be absent only where this page says so.
- New fields may be added; a program must ignore what it does not know. A command alone
  may have no other fields.
- An empty retained payload deletes a topic at the broker, because its starter, line or alarm is gone.
- What is published again is the same, byte for byte: a program removes duplicates by topic, `boot` and `seq`.
  An item of `history` is the message of `value/{{point}}` with the same two. A result has neither:
  its topic, `id`, `phase`, `duplicate` and `time` name it.
"""
ABOUT = """\
Starter Gateway connects motor soft-starters on RS-485 lines (Modbus RTU) to MQTT; not a safety function.
Times are UTC, RFC 3339 with milliseconds. Floats always have a decimal part. No topic that carries a payload
is a prefix of another."""
COMMANDS = "From an operator, never retained. `stop` needs no payload at all."
PARAMETERS = {
    "base": "what all topics begin with: `mqtt.base`, by default starters/ and the gateway's name",
    "starter": "name of the starter",
    "line": "name of the line",
    "point": "name of the point; the family pages list them",
    "code": "code of the fault or alarm, in lower case",
    "client": "the client's name: the broker's access list ties it to a login",
    "verb": "what to do",
}
DELETED = {
    "title": "Deleted",
    "description": "Empty and retained: the topic is deleted, because its starter, line or alarm is gone.",
    "contentType": "application/octet-stream",
    "payload": {"type": "string", "maxLength": 0},
}
WORDS = {"string": "text", "integer": "whole number", "boolean": "true, false", "array": "list"}
PASSED_ON = ("type", "pattern", "enum", "description")  # of a schema, besides its parts


@dataclass(frozen=True)
class Topic:
    """One topic: its address below `B`, how it is delivered, and the JSON Schema of its payload."""

    name: str
    kind: type[Record] | None  # None: a command, which the gateway receives
    address: str
    meaning: str
    schema: Mapping[str, Any]

    @property
    def delivery(self) -> tuple[int, bool]:
        """Return QoS and retain."""
        return (self.kind.QOS, self.kind.RETAIN) if self.kind else (1, False)

    @property
    def messages(self) -> tuple[str, ...]:
        """Return the messages; what is retained of a starter or a line may be deleted at the broker."""
        return (self.name, "deleted") if self.delivery[1] and "{" in self.address else (self.name,)


def closed(schema: Mapping[str, Any]) -> dict[str, Any]:
    """Return a schema that permits no field that it does not name."""
    inner = {name: closed(each) for name, each in schema.items() if name in ("items", "additionalProperties")}
    if "properties" in schema:
        named = {name: closed(each) for name, each in schema["properties"].items()}
        inner = {"properties": named, "additionalProperties": False} | inner
    return {**schema, **inner}


def document() -> dict[str, Any]:
    """Return the AsyncAPI file as data."""
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
        "operations": {_action(topic) + _title(topic): _operation(topic) for topic in TOPICS},
        "components": {"messages": {**{topic.name: _message(topic) for topic in TOPICS}, "deleted": DELETED}},
    }


def asyncapi() -> str:
    """Return the AsyncAPI file as text."""
    text = yaml.dump(document(), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)
    return f"# {MADE}\n{text}"


def topics_page() -> str:
    """Return docs/reference/topics.md."""
    rows = ((f"[`B/{each.address}`](#{each.name.lower()})", each.meaning) for each in TOPICS)
    return "\n".join([table(HEAD.rstrip(), ("topic", "what"), rows), *map(_section, TOPICS)])


class _Dumper(yaml.SafeDumper):
    """Writes everything out, since not every reader of AsyncAPI files knows anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _channel(topic: Topic) -> Mapping[str, Any]:
    names = ["base", *re.findall(r"{(\w+)}", topic.address)]
    return {
        "address": f"{{base}}/{topic.address}",
        "description": topic.meaning,
        "parameters": {name: {"description": PARAMETERS[name]} for name in names},
        "messages": {name: {"$ref": f"#/components/messages/{name}"} for name in topic.messages},
    }


def _operation(topic: Topic) -> Mapping[str, Any]:
    qos, retain = topic.delivery
    return {
        "action": _action(topic),
        "channel": {"$ref": f"#/channels/{topic.name}"},
        "bindings": {"mqtt": {"qos": qos, "retain": retain, "bindingVersion": "0.2.0"}},
        "messages": [{"$ref": f"#/channels/{topic.name}/messages/{name}"} for name in topic.messages],
    }


def _message(topic: Topic) -> Mapping[str, Any]:
    # Fields may be added to everything that is sent; a command may have no others.
    schema = topic.schema if topic.kind else {**topic.schema, "additionalProperties": False}
    return {"title": _title(topic), "contentType": "application/json", "payload": schema}


def _action(topic: Topic) -> str:
    return "send" if topic.kind else "receive"


def _title(topic: Topic) -> str:
    return topic.name[0].upper() + topic.name[1:]


def _section(topic: Topic) -> str:
    qos, is_retained = topic.delivery
    retained = "retained" if is_retained else "not retained" if topic.kind else "never retained"
    deleted = " An empty payload deletes it." if "deleted" in topic.messages else ""
    others = topic.schema.get("additionalProperties")
    title = f"## `B/{topic.address}` {{#{topic.name.lower()}}}\n\n{topic.meaning}"
    rows = [*_rows(topic.schema, ""), *([("*others*", "", others["description"])] if others else [])]
    return table(f"{title}\nQoS {qos}, {retained}.{deleted}", ("field", "type", "meaning"), rows)


def _rows(schema: Mapping[str, Any], path: str) -> Iterator[tuple[str, ...]]:
    for name, each in schema.get("properties", {}).items():
        absent = "" if name in schema.get("required", ()) else ", or absent"
        values = " ".join(f"`{value}`" for value in each.get("enum", ()) if value is not None)
        meaning = each["description"] + (f" ({values})" if values else "")
        yield f"`{path}{name}`", f"{_kind(each)}{absent}", meaning
        yield from _rows(each, f"{path}{name}.")
        yield from _rows(each.get("items", {}), f"{path}{name}[].")
        yield from _rows(each.get("additionalProperties", {}), f"{path}{name}.*.")


def _kind(schema: Mapping[str, Any]) -> str:
    kinds = schema.get("type", "any")
    kind, *null = kinds if isinstance(kinds, list) else [kinds]
    word = "time" if "pattern" in schema else WORDS.get(kind, kind)
    inner = schema.get("items") or schema.get("additionalProperties") or {}
    if "additionalProperties" in schema:
        word += " by key"
    if "type" in inner and "properties" not in inner:
        word += f" of {_kind(inner).replace(', or ', ' or ')}"
    return f"{word}, or null" if null else word


def _flat(schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> dict[str, Any]:
    """Return a schema of pydantic's without references, titles and defaults."""
    if "$ref" in schema:
        schema = {**definitions[schema["$ref"].rpartition("/")[2]], **schema}
    kinds = [_flat(each, definitions) for each in schema.get("anyOf", ())]
    is_nullable = {"type": "null"} in kinds
    kinds = [each for each in kinds if each != {"type": "null"}]
    if len(kinds) == 1:
        schema = {**kinds[0], **schema}
    flat = {name: schema[name] for name in PASSED_ON if name in schema}
    if is_nullable and "type" in flat:
        flat["type"] = [flat["type"], "null"]
        if "enum" in flat:
            flat["enum"] = [*(each for each in flat["enum"] if each is not None), None]
    required = schema.get("required", ())
    if "properties" in schema:
        flat["properties"] = {
            name: _flat(each if name in required else _without_null(each), definitions)
            for name, each in schema["properties"].items()
        }
    if required:
        flat["required"] = list(required)
    for part in ("items", "additionalProperties"):
        if schema.get(part, False) is not False:
            flat[part] = {} if schema[part] is True else _flat(schema[part], definitions)
    return flat


def _without_null(schema: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the schema of a field that is left out where it would be null, else as it is."""
    if schema.get("default", ...) is not None:
        return schema
    return {**schema, "anyOf": [each for each in schema["anyOf"] if each != {"type": "null"}]}


class _Schema(GenerateJsonSchema):
    """Every field of a record is in its JSON, but one that is left out where it says nothing."""

    def field_is_required(
        self,
        field: ModelField | DataclassField | TypedDictField,
        total: bool,
    ) -> bool:
        if field["type"] == "typed-dict-field":
            return field.get("required", total)
        return field.get("serialization_exclude_if") is None


def _schema_of(kind: type[Record]) -> dict[str, Any]:
    """Return the JSON Schema of a record's payload, the items of `BESIDE` among its fields."""
    schema = TypeAdapter(kind).json_schema(mode="serialization", schema_generator=_Schema)
    if kind.BESIDE:
        items = schema["properties"].pop(kind.BESIDE)
        if "$ref" in items:
            items = schema["$defs"][items["$ref"].rpartition("/")[2]]
            schema["properties"] |= items["properties"]
            schema["required"] = [*schema.get("required", ()), *items.get("required", ())]
        else:
            schema["additionalProperties"] = {"description": items["description"]}
    return schema


def _topic(name: str, kind: type[Record] | None, address: str = "", meaning: str = "") -> Topic:
    found = _schema_of(kind) if kind else TypeAdapter(CommandBody).json_schema()
    schema = _flat(found, found.get("$defs", {}))
    schema.pop("description", None)
    meaning = meaning or " ".join((kind.__doc__ or "").split())
    return Topic(name, kind, address or kind.TOPIC, meaning, schema)


TOPICS = (
    _topic("gatewayStatus", contract.StatusRecord),
    _topic("gatewayFresh", contract.FreshRecord),
    _topic("gatewayInfo", contract.GatewayRecord),
    _topic("lineStatistics", contract.LineRecord),
    _topic("outbox", contract.OutboxRecord),
    _topic("gatewayEvent", contract.EventRecord, "gateway/event"),
    _topic("starterInfo", contract.InfoRecord),
    _topic("starterAvailability", contract.AvailabilityRecord),
    _topic("starterState", contract.StateRecord),
    _topic("starterValue", contract.ValueRecord),
    _topic("starterAlarm", contract.AlarmRecord),
    _topic("starterEvent", contract.EventRecord),
    _topic("starterStart", contract.StartRecord),
    _topic("starterTrip", contract.TripRecord),
    _topic("starterHistory", contract.HistoryRecord),
    _topic("command", None, "command/{starter}/{client}/{verb}", COMMANDS),
    _topic("result", contract.ResultRecord),
    _topic("audit", contract.AuditRecord),
)
