"""An edge node without a socket: records in, decoded messages out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gateway.mqtt.contract.payloads import Message
from gateway.records import (
    AlarmRecord,
    AvailabilityRecord,
    InfoRecord,
    LineRecord,
    LockRecord,
    Quality,
    Record,
    StateRecord,
    ValueRecord,
)
from gateway.sparkplug import payload as sparkplug_payload
from gateway.sparkplug.metrics import NodeMetrics
from gateway.sparkplug.node import EdgeNode
from gateway.sparkplug.topics import EdgeTopics
from gateway.starters.policy.rights import Operator, Rights

EPOCH_S = 1_760_000_000.0
SINCE_S = EPOCH_S + 40.0  # when the gateway began
TYPES = {3: "Int32", 4: "Int64", 10: "Double", 11: "Boolean", 12: "String"}
POINTS = {
    "current": {"type": "float", "unit": "A", "name": "Motor current"},
    "starts_total": {"type": "integer", "unit": "", "name": "Starts"},
    "fault_code": {"type": "enum", "unit": "", "name": "Fault"},
    "running": {"type": "boolean", "unit": "", "name": "Running"},
    "text": {"type": "string", "unit": "", "name": "Text"},
}
PROPERTIES = {"Properties/Hardware Make": "x86_64", "Properties/OS": "Linux"}
FACTS = {"gateway/status": "online", "broker/connected": True, "outbox/depth": 0, "outbox/oldest_s": 0.0}


@dataclass
class NodeMessage:
    """A message as a host reads it."""

    topic: str
    kind: str
    device: str | None
    qos: int
    retain: bool
    time_ms: int | None
    seq: int | None
    metrics: list[dict[str, Any]]
    payload: bytes = field(repr=False, default=b"")

    def __getitem__(self, name: str) -> dict[str, Any]:
        return next(each for each in self.metrics if each["name"] == name)

    @property
    def names(self) -> list[str]:
        return [each["name"] for each in self.metrics]

    @property
    def values(self) -> dict[str, Any]:
        return {each["name"]: each["value"] for each in self.metrics}


def read(message: Message) -> NodeMessage:
    """Decode a message."""
    levels = message.topic.split("/")
    decoded = sparkplug_payload._PAYLOAD()
    decoded.ParseFromString(message.payload)
    return NodeMessage(
        topic=message.topic,
        kind=levels[2],
        device=levels[4] if len(levels) > 4 else None,
        qos=message.qos,
        retain=message.retain,
        time_ms=decoded.timestamp if decoded.HasField("timestamp") else None,
        seq=decoded.seq if decoded.HasField("seq") else None,
        metrics=[_metric(each) for each in decoded.metrics],
        payload=message.payload,
    )


def _metric(metric: Any) -> dict[str, Any]:
    fields = ("int_value", "long_value", "float_value", "double_value", "boolean_value", "string_value")
    there = [name for name in fields if metric.HasField(name)]
    assert len(there) == (0 if metric.is_null else 1), metric
    read = {
        "name": metric.name,
        "time_ms": metric.timestamp if metric.HasField("timestamp") else None,
        "type": TYPES[metric.datatype] if metric.HasField("datatype") else None,
        "value": getattr(metric, there[0]) if there else None,
        "field": there[0] if there else None,
        "null": metric.is_null,
        "alias": metric.HasField("alias"),
        "properties": {},
        "keys": list(metric.properties.keys),
        "property_types": [value.type for value in metric.properties.values],
    }
    for key, value in zip(metric.properties.keys, metric.properties.values, strict=True):
        read["properties"][key] = value.int_value if value.HasField("int_value") else value.string_value
    return read


class NodeRig:
    """One node with two starters; `say` returns what a host would see."""

    def __init__(
        self,
        *,
        operator: str | None = None,
        may: tuple[str, ...] = ("*",),
        has_datatypes: bool = False,
        is_begun: bool = True,
    ) -> None:
        self.now_s = 100.0
        self.node = EdgeNode(
            EdgeTopics("plant", "mcc1"),
            NodeMetrics(PROPERTIES, ("hall",), FACTS),
            ("pump", "fan"),
            since_s=SINCE_S,
            operator=operator,
            rights=Rights([Operator(operator or "", may, ("pump",))]),
            has_datatypes=has_datatypes,
        )
        if is_begun:
            self.node.begin(7)

    @property
    def utc_s(self) -> float:
        return EPOCH_S + self.now_s

    def put(self, *records: Record) -> None:
        for record in records:
            self.node.put(record, now_s=self.now_s, utc_s=self.utc_s)

    def say(self, *, after_s: float = 0.0) -> list[NodeMessage]:
        """Let time pass, then return all that is due."""
        self.now_s += after_s
        said = []
        while (message := self.node.take(now_s=self.now_s, utc_s=self.utc_s)) is not None:
            said.append(read(message))
        return said

    def online(self, *starters: str) -> None:
        for starter in starters or ("pump", "fan"):
            self.put(info(starter), availability(starter, "online", self.utc_s))

    def born(self) -> list[NodeMessage]:
        """Have both starters answer; return the births."""
        self.online()
        return self.say()


def info(starter: str, **changes: Any) -> InfoRecord:
    given: dict[str, Any] = {
        "family": "ssw07",
        "model": "SSW-07 130A",
        "firmware": "1.30",
        "serial": "77",
        "line": "hall",
        "address": 1,
        "points": POINTS,
        "commands": ("start", "stop", "reset", "set", "select"),
        **changes,
    }
    return InfoRecord(starter, **given)


def availability(starter: str, state: str, time_s: float, reason: str | None = None) -> AvailabilityRecord:
    return AvailabilityRecord(starter, state, time_s, reason)


def value(
    starter: str,
    point: str,
    is_: Any,
    *,
    quality: Quality = Quality.GOOD,
    time_s: float | None = EPOCH_S + 50.0,
) -> ValueRecord:
    return ValueRecord(starter, point, is_, "A", quality, time_s, 1)


def state(
    starter: str, name: str = "ready", *, lock: LockRecord | None = None, **flags: bool | None
) -> StateRecord:
    return StateRecord(starter, name, Quality.GOOD, EPOCH_S + 60.0, 1, flags, lock)


def alarm(starter: str, code: str, *, is_active: bool = True, severity: str = "fault") -> AlarmRecord:
    cleared_s = None if is_active else EPOCH_S + 90.0
    return AlarmRecord(starter, code, is_active, severity, f"text of {code}", EPOCH_S + 80.0, cleared_s, 1, 1)


def line(statistics: Mapping[str, Any]) -> LineRecord:
    return LineRecord("hall", statistics)


def dcmd(*writes: dict[str, Any], time_s: float | None = EPOCH_S + 100.0) -> bytes:
    """Return a DCMD as a host writes it."""
    message = sparkplug_payload._PAYLOAD()
    if time_s is not None:
        message.timestamp = round(time_s * 1000)
    for write in writes:
        metric = message.metrics.add()
        for name, each in write.items():
            setattr(metric, name, each)
    return bytes(message.SerializeToString())


def write(name: str, value: bool = True, **more: Any) -> dict[str, Any]:
    """Return one metric of a DCMD."""
    return {"name": name, "boolean_value": value, **more}


def host_says(online: bool, timestamp: int) -> bytes:
    return f'{{"online": {str(online).lower()}, "timestamp": {timestamp}}}'.encode()
