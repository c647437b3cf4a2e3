"""Converts records to messages: topic, payload, quality of service, and retained or queued.

A retained message is the newest of its topic. A queued message (event, result, audit, history, start, trip)
is sent in order and repeated until acknowledged. Most messages are values: `ValueTexts` formats their JSON
directly. In all JSON floats have a decimal part and are never NaN, times are RFC 3339 in UTC.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import lru_cache
from json.encoder import encode_basestring
from typing import Any, NamedTuple, assert_never

from gateway.mqtt.contract.freshness import RunToken, boot_of
from gateway.mqtt.contract.topics import Topics, to_level
from gateway.records import (
    AlarmRecord,
    AuditRecord,
    AvailabilityRecord,
    EventRecord,
    InfoRecord,
    LineRecord,
    LockRecord,
    Quality,
    Record,
    ResultRecord,
    StartRecord,
    StateRecord,
    TripRecord,
    ValueRecord,
    rfc3339,
)
from gateway.starters.policy.rights import Operator


class ValueText(NamedTuple):
    """A value's JSON for its own topic."""

    topic: str
    text: str


class LateValue(NamedTuple):
    """A value that is published late: the history topic, and the item's JSON."""

    topic: str
    item: bytes


class ValueTexts:
    """Formats values of this run (`boot`); caches the topic of each point."""

    def __init__(self, topics: Topics, boot: str) -> None:
        self._topics = topics
        self._boot = to_json(boot)
        self._known: dict[str, dict[str, str]] = {}  # by starter and point

    def of(self, record: ValueRecord) -> ValueText:
        """Return a value's texts; ValueError when the starter's name is no topic level."""
        known = self._known.get(record.starter)
        topic = None if known is None else known.get(record.point)
        if topic is None:
            topic = self._topics.value(record.starter, to_level(record.point))
            self._known.setdefault(record.starter, {})[record.point] = topic
        value = to_json(record.value)
        fate = f'"quality":"{record.quality}","time":{_quoted(record.time_s)},"seq":{record.seq}'
        label = "" if record.label is None else f',"label":{to_json(record.label)}'
        reason = f',"reason":{to_json(record.reason)}' if record.reason else ""
        text = f'{{"value":{value},"unit":{to_json(record.unit)},{fate},"boot":{self._boot}{label}{reason}}}'
        return ValueText(topic, text)

    def records_in(self, latest: Mapping[str, Message]) -> Iterator[ValueRecord]:
        """Yield the values that retained messages, by topic, say; one that was cleared says none."""
        for starter, topics in tuple(self._known.items()):
            for point, topic in tuple(topics.items()):
                message = latest.get(topic)
                if message is not None and message.payload:
                    yield _value_record(starter, point, json.loads(message.payload))


def _value_record(starter: str, point: str, said: Mapping[str, Any]) -> ValueRecord:
    time = said["time"]
    return ValueRecord(
        starter=starter,
        point=point,
        value=said["value"],
        unit=said["unit"],
        quality=Quality(said["quality"]),
        time_s=None if time is None else datetime.fromisoformat(time).timestamp(),
        seq=said["seq"],
        label=said.get("label"),
        reason=said.get("reason", ""),
    )


def late_value(message: Message) -> LateValue:
    """Return what the history says of a value's message; cut out of its JSON."""
    branch, _, level = message.topic.rpartition("/")
    value, _, rest = message.payload.partition(b',"unit":')  # no string can hold such a sequence
    fate = rest[rest.index(b',"quality":') : rest.index(b',"boot":')]
    item = b'{"point":"%b",%b%b}' % (level.encode(), value[1:], fate)
    return LateValue(f"{branch.removesuffix('value')}history", item)


@lru_cache(maxsize=64)  # the points of one reply have one time
def _quoted(time_s: float | None) -> str:
    return to_json(rfc3339(time_s))


CONTRACT_VERSION = 1
MAX_HISTORY_ITEMS = 200


class Message(NamedTuple):
    """One publication: queued until acknowledged, or replaced by the next one of its topic."""

    topic: str
    payload: bytes
    qos: int
    retain: bool
    is_queued: bool = False
    is_droppable: bool = False  # goes first when the outbox is full
    correlation: bytes | None = None  # MQTT 5 only
    is_value: bool = False  # published late when a newer value replaces it before it was sent
    key: str = ""  # names what must be published once: a final result ("client/id"), a start or a trip

    @property
    def packet_size(self) -> int:
        """Return the size of the PUBLISH packet, at most [MQTT5 3.3]."""
        return 20 + len(self.topic) + len(self.payload) + len(self.correlation or b"")


@dataclass(frozen=True, slots=True)
class GatewayInfo:
    """The contents of `gateway/info`."""

    version: str
    starters: tuple[str, ...]
    lines: tuple[str, ...]
    operators: tuple[Operator, ...]
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # name -> members, for stop
    mqtt_version: str | None = None  # of the connection; None before the first


class Payloads:
    """Converts records to messages below one base; `boot` names this run of the gateway."""

    def __init__(self, topics: Topics, boot: RunToken | str) -> None:
        self.topics = topics
        self._boot = boot_of(boot)
        self._values = ValueTexts(topics, self._boot.run)

    def message(self, record: Record) -> Message:
        """Return the message of a record; ValueError when a name in it is no topic level."""
        match record:
            case ValueRecord():
                return self._value(record)
            case StateRecord():
                return self._state(record)
            case AvailabilityRecord():
                return self._availability(record)
            case AlarmRecord():
                return self._alarm(record)
            case InfoRecord():
                return self._info(record)
            case EventRecord():
                return self._event(record)
            case ResultRecord():
                return self._result(record)
            case AuditRecord():
                return self._audit(record)
            case StartRecord():
                return _queued(
                    self.topics.start(record.starter), record.data, is_droppable=True, key=record.key
                )
            case TripRecord():
                return _queued(self.topics.trip(record.starter), record.data, key=record.key)
            case LineRecord():
                return _latest(self.topics.line(record.line), record.statistics, qos=0)
            case _:
                assert_never(record)

    def values_in(self, latest: Mapping[str, Message]) -> Iterator[ValueRecord]:
        """Yield the values that retained messages, by topic, say: what `message` made of them, read back."""
        return self._values.records_in(latest)

    def status(
        self, state: str, *, time_s: float | None, since_s: float | None, reason: str | None
    ) -> Message:
        """Return the gateway's status; as the will, the times are unknown and so null."""
        fields = {
            "state": state,
            "time": rfc3339(time_s),
            "boot": self._boot.token,
            "since": rfc3339(since_s),
            "reason": reason,
            "run": self._boot.run,
        }
        return _latest(self.topics.gateway_status, fields)

    def fresh(self, token: str, time_s: float) -> Message:
        """Return the proof of freshness that a command echoes."""
        fields = {"token": token, "time": rfc3339(time_s)}
        return _latest(self.topics.gateway_fresh, fields, qos=0)

    def gateway_info(self, info: GatewayInfo) -> Message:
        """Return what this gateway is."""
        fields = {
            "product": "starter-gateway",
            "version": info.version,
            "contract": CONTRACT_VERSION,
            "boot": self._boot.run,
            "mqtt_version": info.mqtt_version,
            "starters": info.starters,
            "lines": info.lines,
            "operators": [
                {
                    "client": operator.client,
                    "may": operator.may,
                    "starters": operator.starters,
                    "freshness": operator.freshness,
                }
                for operator in info.operators
            ],
            "notice": "not a safety function",
        }
        if info.groups:
            fields["groups"] = dict(info.groups)
        return _latest(self.topics.gateway_info, fields)

    def outbox(self, statistics: Mapping[str, Any]) -> Message:
        """Return the outbox's statistics."""
        return _latest(self.topics.gateway_outbox, statistics, qos=0)

    def history(self, topic: str, items: Sequence[str], boot: str) -> Message:
        """Return a batch of values of a run, published late: at most MAX_HISTORY_ITEMS, each JSON already."""
        payload = f'{{"boot":{to_json(boot)},"items":{join_json(items)}}}'.encode("utf-8", "replace")
        return Message(topic, payload, qos=1, retain=False, is_queued=True, is_droppable=True)

    def _value(self, record: ValueRecord) -> Message:
        made = self._values.of(record)
        return Message(made.topic, made.text.encode("utf-8", "replace"), qos=1, retain=True, is_value=True)

    def _state(self, record: StateRecord) -> Message:
        fields: dict[str, Any] = {
            "state": record.state,
            "quality": record.quality,
            "time": rfc3339(record.time_s),
            "seq": record.seq,
            "boot": self._boot.run,
        }
        if record.reason:
            fields["reason"] = record.reason
        if record.fault_code is not None:
            fields["fault_code"] = record.fault_code
        fields["locked"] = _lock(record.lock)
        return _latest(self.topics.state(record.starter), _extended(fields, record.flags))

    def _availability(self, record: AvailabilityRecord) -> Message:
        fields = {"state": record.state, "since": rfc3339(record.since_s), "reason": record.reason}
        return _latest(self.topics.availability(record.starter), fields)

    def _alarm(self, record: AlarmRecord) -> Message:
        fields = {
            "active": record.is_active,
            "severity": record.severity,
            "text": record.text,
            "time": rfc3339(record.time_s),
            "cleared": rfc3339(record.cleared_s),
            "count": record.count,
            "seq": record.seq,
            "boot": self._boot.run,
        }
        return _latest(self.topics.alarm(record.starter, to_level(record.code)), fields)

    def _info(self, record: InfoRecord) -> Message:
        fields = {
            "family": record.family,
            "model": record.model,
            "firmware": record.firmware,
            "serial": record.serial,
            "hardware": record.hardware,
            "rated_current_a": record.rated_current_a,
            "rating": record.rating,
            "slot": record.slot,
            "accessories": record.accessories or None,
            "line": record.line,
            "address": record.address,
            "points": {to_level(name): point for name, point in record.points.items()},
            "commands": record.commands,
        }
        return _latest(self.topics.info(record.starter), fields)

    def _event(self, record: EventRecord) -> Message:
        fields = {
            "seq": record.seq,
            "time": rfc3339(record.time_s),
            "boot": self._boot.run,
            "code": record.code,
            "severity": record.severity,
            "text": record.text,
            "data": record.data,
        }
        return _queued(self.topics.event(record.starter), fields, is_droppable=True)

    def _result(self, record: ResultRecord) -> Message:
        fields = {
            "id": record.id,
            "verb": record.verb,
            "phase": record.phase,
            "code": record.code,
            "text": record.text,
            "time": rfc3339(record.time_s),
            "duplicate": record.is_duplicate,
        }
        # An accepted response topic is this very topic, so `response_topic` need not be looked at again.
        topic = self.topics.result(record.starter, record.client)
        return _queued(
            topic, _extended(fields, record.values), correlation=record.correlation, key=record.key
        )

    def _audit(self, record: AuditRecord) -> Message:
        claims = {"operator": record.operator, "reason": record.reason}
        fields = {**record.as_data(), **claims, "boot": self._boot.run}
        return _queued(self.topics.audit, fields, is_droppable=True)


def _lock(lock: LockRecord | None) -> dict[str, Any] | None:
    if lock is None:
        return None
    fields = {"by": lock.by, "operator": lock.operator, "since": rfc3339(lock.since_s), "reason": lock.reason}
    return {**fields, "notice": "replaces no physical lock"}


def cleared(topic: str) -> Message:
    """Return the message that makes the broker forget a retained topic."""
    return Message(topic, b"", qos=1, retain=True)


def _latest(topic: str, fields: Mapping[str, Any], *, qos: int = 1) -> Message:
    return Message(topic, to_payload(fields), qos=qos, retain=True)


def _queued(
    topic: str,
    fields: Mapping[str, Any],
    *,
    is_droppable: bool = False,
    correlation: bytes | None = None,
    key: str = "",
) -> Message:
    return Message(
        topic,
        to_payload(fields),
        qos=1,
        retain=False,
        is_queued=True,
        is_droppable=is_droppable,
        correlation=correlation,
        key=key,
    )


def _extended(fields: dict[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Return `fields` with what `more` adds; the contract's own keys cannot be overwritten."""
    return {**fields, **{key: value for key, value in more.items() if key not in fields}}


def to_json(value: Any) -> str:
    """Return compact JSON; what JSON cannot say becomes null (NaN, infinity) or its text."""
    kind = type(value)
    if kind is str:  # most are, and nearly all the rest are floats
        return encode_basestring(value)
    if kind is float:
        return _float_text(value)
    match value:
        case None:
            return "null"
        case bool():
            return "true" if value else "false"
        case int():
            return int.__repr__(value)
        case float():
            return _float_text(value)
        case str():
            return encode_basestring(str(value))
        case Mapping():
            return "{" + ",".join(f"{to_json(str(key))}:{to_json(item)}" for key, item in value.items()) + "}"
        case list() | tuple() | set() | frozenset():
            return join_json(to_json(item) for item in value)
        case _:
            return to_json(str(value))


def join_json(items: Iterable[str]) -> str:
    """Return a JSON array of items that are JSON already."""
    return "[" + ",".join(items) + "]"


def to_payload(value: Any) -> bytes:
    """Return `to_json` as UTF-8; lone surrogates, which UTF-8 cannot carry, become `?`."""
    return to_json(value).encode("utf-8", "replace")


def _float_text(value: float) -> str:
    if not math.isfinite(value):
        return "null"
    text = float.__repr__(value)
    if "e" not in text:
        return text
    mantissa, exponent, power = text.partition("e")
    if "." not in mantissa:
        mantissa += ".0"  # 1e+16, which some clients would take for an integer tag
    return f"{mantissa}{exponent}{power}"
