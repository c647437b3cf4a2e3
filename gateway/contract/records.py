"""Records: everything that the gateway says, each a type that is its own payload.

The fields of a record, in this order, are the keys of its JSON, except those in the topic. The header of its
class says how it is published: a retained message is the newest of its topic, any other is sent in order
until the broker has acknowledged it, and a full outbox drops the droppable ones first.

Times are seconds since 1970, UTC; in JSON RFC 3339 with milliseconds. `seq` identifies and orders the records
of one run (`boot`). The reference and asyncapi.yaml are generated from these types.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from operator import not_
from typing import Annotated, Any, ClassVar, Literal, TypeVar, dataclass_transform

from pydantic import BeforeValidator, Field, PlainSerializer

from gateway.contract.events import EventCode
from gateway.contract.json_text import adapter_of, encoded, read_object
from gateway.contract.results import meaning_of
from gateway.contract.statistics import LineStatistics
from gateway.contract.topics import LEVEL, to_level
from gateway.contract.values import PointInfo, ResultValues, StartSamples, says
from gateway.contract.vocabulary import (
    CONTRACT_VERSION,
    GatewayState,
    Phase,
    Quality,
    Severity,
    StarterState,
    rfc3339,
    seconds_of,
)
from gateway.contract.wording import names_in

Number = bool | int | float
Row = Mapping[str, Any]
R = TypeVar("R", bound="Record")
T = TypeVar("T")
InTopic = Annotated[str, Field(exclude=True)]


def _seconds(time: object) -> float:
    return math.nan if time is None else seconds_of(time)


_Text = Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z$")]
_AS_TEXT = PlainSerializer(rfc3339, return_type=_Text | None)  # null: beyond the calendar
Time = Annotated[float, BeforeValidator(_seconds), _AS_TEXT]
PossibleTime = Time | None
Seq = Annotated[int, says("counts up by one over everything that this run publishes")]
Boot = Annotated[
    str, says("names this run of the gateway: topic, boot and seq name a message once and for all")
]
Trust = Annotated[
    Quality,
    says(
        "good: just read; stale: the last good value, with its own time; bad: never read, refused, impossible"
    ),
]
_WARNING = says("this text, a warning")
Presence = Literal["online", "degraded", "offline", "disabled"]
StartOutcome = Literal["full_voltage", "tripped", "stopped", "given_up"]  # full voltage: also bypass
# Command: a client of the gateway. Local: the keypad or inputs, as the starter shows it. Remote: the serial
# line or another remote source, but not the gateway.
StartSource = Literal["command", "local", "remote", "unknown"]
MqttVersion = Annotated[str | None, Field(json_schema_extra={"enum": ["5", "3.1.1", None]})]


def _maybe(description: str) -> Any:
    """Describe a field that is absent from the JSON where it says nothing."""
    return says(description, exclude_if=lambda value: value is None or value == "")


def _if_any(description: str) -> Any:
    """Describe a field that is absent from the JSON where it is 0 or empty."""
    return says(description, exclude_if=not_)


def _beside(description: str) -> Any:
    """Describe the items of the field that `BESIDE` names."""
    return says(description, exclude_if=lambda _: True)


def _described_by(kind: Any) -> PlainSerializer:
    """Describe JSON that is made elsewhere by a type of its own."""
    return PlainSerializer(lambda made: made, return_type=kind)


def _rounded(digits: int) -> PlainSerializer:
    return PlainSerializer(lambda number: round(number, digits), return_type=float)


def _empty() -> Any:
    return field(default_factory=dict)


Measured = Annotated[float, _rounded(4)]
Samples = Annotated[Mapping[str, tuple[float | None, ...]], _described_by(StartSamples)]


def _made_keys(kind: type[Record]) -> frozenset[str]:
    """Return the keys of its JSON, but of what is beside the other fields."""
    return frozenset(adapter_of(kind).json_schema(mode="serialization")["properties"]) - {kind.BESIDE}


_own_keys_of: Callable[[Any], frozenset[str]] = cache(_made_keys)


_level_of = cache(to_level)  # starters and points have few names; with their topics they would have many


@cache
def _form_of(template: str) -> str:
    return template.format_map(dict.fromkeys(names_in(template), "%s"))


def _filled(template: str, *names: str) -> str:
    return _form_of(template) % tuple(map(_level_of, names))


@cache
def _pattern(template: str) -> re.Pattern[str]:
    return re.compile(re.sub(r"{(\w+)}", rf"(?P<\1>{LEVEL})", template))


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(field,))
class Record:
    """One thing that the gateway says; its payload is its fields. Every kind is a frozen dataclass."""

    TOPIC: ClassVar[str]  # below the base, with the names of fields
    QOS: ClassVar[int]
    RETAIN: ClassVar[bool]
    IS_DROPPABLE: ClassVar[bool]  # before others, where it is not retained
    BESIDE: ClassVar[str]  # the field whose items stand beside the other fields in the JSON

    def __init_subclass__(
        cls,
        topic: str = "",
        *,
        qos: int = 1,
        retain: bool = True,
        is_droppable: bool = False,
        beside: str = "",
    ) -> None:
        """Take from the header of a class how its records are published."""
        cls.TOPIC, cls.QOS, cls.RETAIN = topic, qos, retain
        cls.IS_DROPPABLE, cls.BESIDE = is_droppable, beside
        dataclass(frozen=True, kw_only=True)(cls)

    @property
    def topic(self) -> str:
        """Return the topic below the base; a character that no level may have is `_` there."""
        return _filled(self.TOPIC, *[getattr(self, name) for name in names_in(self.TOPIC)])

    @classmethod
    def topic_of(cls, **names: str) -> str:
        """Return the topic of such a record below the base."""
        return _filled(cls.TOPIC, *(names[name] for name in names_in(cls.TOPIC)))

    @classmethod
    def names_of(cls, topic: str) -> dict[str, str] | None:
        """Return the names in a topic below the base; None where such a record has another topic."""
        found = _pattern(cls.TOPIC).fullmatch(topic)
        return None if found is None else found.groupdict()

    @property
    def key(self) -> str:
        """Return what names a record that must be published exactly once; empty for any other."""
        return ""

    def payload(self) -> bytes:
        """Return the record as JSON."""
        payload = encoded(self, type(self))
        if not self.BESIDE:
            return payload
        own = _own_keys_of(type(self))  # which cannot be overwritten
        added = encoded({key: value for key, value in getattr(self, self.BESIDE).items() if key not in own})
        return b"{%b}" % b",".join(filter(None, (payload[1:-1], added[1:-1])))


class StarterRecord(Record):
    """A record of one starter, whose name is in its topic."""

    starter: InTopic


def read_record(kind: type[R], payload: bytes, **names: str) -> R:
    """Return the record of a payload, given the names in its topic; ValueError when it is none.

    A field of a later version is ignored; one that a later version adds here has a default.
    """
    found = read_object(payload)
    own = {key: found.pop(key) for key in _own_keys_of(kind) & found.keys()}
    beside = {kind.BESIDE: found} if kind.BESIDE else {}
    return read_stored(kind, {**own, **beside}, **names)


def read_stored(kind: type[T], data: Mapping[str, Any], **names: str) -> T:
    """Return an object from its JSON, with the names that stand in its topic; ValueError when it is none."""
    found: T = adapter_of(kind).validate_python({**data, **names})
    return found


def stored(thing: object) -> dict[str, Any]:
    """Return an object as `read_stored` reads it; of a record the content of its payload."""
    fields: dict[str, Any] = adapter_of(type(thing)).serializer.to_python(thing, by_alias=True)
    return fields


class ValueRecord(StarterRecord, topic="starter/{starter}/value/{point}"):
    """The value of one point; on change, and again after `mqtt.refresh_s`."""

    point: InTopic
    value: Annotated[bool | int | float | str | None, says("in `unit`; null: not known")]
    unit: Annotated[str, says("its unit; empty for none")]
    quality: Trust
    time_s: Annotated[PossibleTime, says("when the reply left the wire; null: never read", alias="time")]
    seq: Seq
    boot: Boot = ""
    label: Annotated[str | None, _maybe("the name of the value, of an enum")] = None
    reason: Annotated[str, _maybe("why it is bad, where the starter as a whole is the cause")] = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LockRecord:
    """A maintenance lock: by whom, since when and why. It replaces no physical lock."""

    by: Annotated[str, says("the client that set it")]
    operator: Annotated[str | None, says("who that client says it acts for, a claim")] = None
    since_s: Annotated[Time, says("when it was set", alias="since")]
    reason: Annotated[str, says("why")]
    notice: Annotated[Literal["replaces no physical lock"], _WARNING] = "replaces no physical lock"


class StateRecord(StarterRecord, topic="starter/{starter}/state", beside="flags"):
    """What a starter does, at once on change, else every 30 s."""

    state: Annotated[StarterState, says("the one word for it")]
    quality: Trust
    time_s: Annotated[PossibleTime, says("when the oldest of its readings left the wire", alias="time")]
    seq: Seq
    boot: Boot = ""
    reason: Annotated[str, _maybe("why it is unknown although the starter answers")] = ""
    fault_code: Annotated[int | None, _maybe("number of the present fault, where the starter gives one")] = (
        None
    )
    lock: Annotated[LockRecord | None, says("the maintenance lock; null: not locked", alias="locked")] = None
    flags: Annotated[
        Mapping[str, bool | None], _beside("each boolean point by its name: true, false, or null: not known")
    ] = _empty()


class AvailabilityRecord(StarterRecord, topic="starter/{starter}/availability"):
    """Whether a starter answers."""

    state: Annotated[Presence, says("degraded: a part is not read; disabled: it is not asked")]
    since_s: Annotated[Time, says("since when", alias="since")]
    reason: Annotated[str | None, says("why it is not online")]


class AlarmRecord(StarterRecord, topic="starter/{starter}/alarm/{code}"):
    """A fault or alarm that is or was active since the gateway's start."""

    code: InTopic
    is_active: Annotated[bool, says("whether it is active", alias="active")]
    severity: Annotated[Literal["fault", "alarm"], says("a fault trips the motor")]
    text: Annotated[str, says("what the manual calls it")]
    time_s: Annotated[Time, says("when it came last", alias="time")]
    cleared_s: Annotated[PossibleTime, says("when it went; null while it is active", alias="cleared")]
    count: Annotated[int, says("how often it came")]
    seq: Seq
    boot: Boot = ""


class InfoRecord(StarterRecord, topic="starter/{starter}/info"):
    """What a starter is: everything but its values."""

    family: Annotated[str, says("its family")]
    model: Annotated[str | None, says("its model")]
    firmware: Annotated[str | None, says("its firmware")]
    serial: Annotated[str | None, says("its serial number")]
    hardware: Annotated[str | None, says("its hardware version")] = None
    rated_current_a: Annotated[float | None, says("its rated current, A")] = None
    rating: Annotated[str | None, says("SSW900: the currents of its size")] = None
    slot: Annotated[int | None, says("SSW900: slot of the RS-485 accessory")] = None
    accessories: Annotated[tuple[str, ...] | None, says("SSW900: the kinds in slots 1 and 2")] = None
    line: Annotated[str, says("the line that it is on")]
    address: Annotated[int, says("its Modbus address, 1 to 247")]
    points: Annotated[Mapping[str, Row], _described_by(Mapping[str, PointInfo]), says("by name")]
    commands: Annotated[tuple[str, ...], says("the verbs that it has")]
    title: Annotated[str | None, _maybe("its name for people, where the configuration gives one")] = None


class EventRecord(StarterRecord, topic="starter/{starter}/event", retain=False, is_droppable=True):
    """Something that happened once, to a starter or to the gateway."""

    seq: Seq
    time_s: Annotated[Time, says("when it happened", alias="time")]
    boot: Boot = ""
    code: Annotated[EventCode, says("what happened, for programs: see the events")]
    severity: Annotated[Severity, says("error: a person must act")]
    text: Annotated[str, says("what happened, for people")]
    data: Annotated[Mapping[str, Any], says("depends on the code: see the events")] = _empty()

    @property
    def topic(self) -> str:
        """Return the topic below the base."""
        return super().topic if self.starter else "gateway/event"


class ResultRecord(StarterRecord, topic="result/{starter}/{client}", retain=False, beside="values"):
    """Each phase of a command; exactly one final result ends it."""

    client: InTopic
    id: Annotated[str | None, says("of the command")]
    verb: Annotated[str, says("of the command")]
    phase: Annotated[Phase, says("the last four are final")]
    code: Annotated[str, says("why, for programs: see the result codes")]
    text: Annotated[str, says("why, for people")]
    time_s: Annotated[Time, says("when", alias="time")]
    is_duplicate: Annotated[
        bool, says("whether this is the stored result of an id that was used before", alias="duplicate")
    ] = False
    values: Annotated[Mapping[str, Any], _described_by(ResultValues), _beside("by verb and code")] = _empty()
    correlation: Annotated[bytes | None, Field(exclude=True)] = None  # MQTT 5 correlation data, echoed

    @property
    def is_confirmed(self) -> bool:
        """Return whether the starter was seen to do it; nothing else is success."""
        return self.phase is Phase.CONFIRMED

    @property
    def may_have_acted(self) -> bool:
        """Return whether it may have reached the starter without being seen to act: a person must look."""
        return self.phase in (Phase.WRITTEN, Phase.UNCONFIRMED)

    @property
    def what_to_do(self) -> str:
        """Return what an operator should do about it."""
        return meaning_of(self.code).remedy

    @property
    def key(self) -> str:
        """Return what names a command's one final result; empty for every other phase and for repetitions."""
        is_sole = self.phase.is_final and not self.is_duplicate
        return f"{self.client}/{self.id}" if is_sole and self.id else ""


class AuditRecord(Record, topic="audit", retain=False, is_droppable=True):
    """Every decision about a command."""

    seq: Seq
    time_s: Annotated[Time, says("when", alias="time")]
    starter: Annotated[str, says("the starter")]
    client: Annotated[str, says("who commanded, by the broker's login")]
    verb: Annotated[str, says("what")]
    args: Annotated[Mapping[str, Any], says("its arguments, as they were sent")]
    decision: Annotated[str, says("the final phase, or duplicate")]
    code: Annotated[str, says("why, for programs: see the result codes")]
    before: Annotated[Mapping[str, Any], says("points before the write, by name")] = _empty()
    after: Annotated[Mapping[str, Any], says("points after it, by name")] = _empty()
    id: Annotated[str | None, says("of the command")] = None
    source: Annotated[str, _maybe("which way it came, where not by MQTT: web, sparkplug, gateway")] = ""
    operator: Annotated[str | None, says("who decided, a claim")]
    reason: Annotated[str | None, says("why, a claim")] = None
    boot: Boot = ""


@dataclass(frozen=True, slots=True)
class Cause:
    """Who gave a start."""

    source: Annotated[StartSource, says("where it came from")] = "unknown"
    client: Annotated[str | None, _maybe("of a command through the gateway")] = None
    command_id: Annotated[str | None, _maybe("of a command through the gateway")] = None


@dataclass(frozen=True, slots=True)
class QuantityChange:
    """How a quantity of the last starts compares with the baseline."""

    baseline: Annotated[Measured, says("at the baseline")]
    median: Annotated[Measured, says("of the last starts")]
    change_pct: Annotated[float, _rounded(1), says("by how much it has changed, %")]


class _StoredRecord(StarterRecord):
    """A record that is stored until the broker has it, by the `id` of what a starter did."""

    id: str

    @property
    def key(self) -> str:
        """Return what names it until then; no client's name has a colon in it."""
        return f"{self.starter}:{self.TOPIC.rpartition('/')[2]}/{self.id}"


class StartRecord(_StoredRecord, topic="starter/{starter}/start", retain=False, is_droppable=True):
    """One start of a motor with its samples, once it is over; after a kill perhaps once more, by its `id`."""

    id: Annotated[str, says("names the start")]
    time_s: Annotated[Time, says("when the motor began to accelerate", alias="time")]
    boot: Boot
    seq: Seq
    cause: Annotated[Cause, says("who gave the start")] = Cause()
    outcome: Annotated[StartOutcome, says("its end; given_up: the gateway lost sight of it")]
    standstill_s: Annotated[Measured | None, _maybe("at rest before, as far as it was seen, s")] = None
    rate_hz: Annotated[Measured | None, _maybe("samples of the current by their time, Hz")] = None
    rated_a: Annotated[Measured | None, _maybe("rated current, A")] = None
    acceleration_s: Annotated[Measured | None, _maybe("acceleration time, s")] = None
    resolution_s: Annotated[Measured | None, _maybe("its uncertainty, plus or minus, s")] = None
    peak_a: Annotated[Measured | None, _maybe("highest current, A")] = None
    mean_a: Annotated[Measured | None, _maybe("mean current while it accelerated, A")] = None
    i2t_a2s: Annotated[Measured | None, _maybe("integral of the squared current, A²s")] = None
    i2t_error_pct: Annotated[Measured | None, _maybe("its uncertainty, plus or minus, %")] = None
    lowest_v: Annotated[Measured | None, _maybe("lowest line voltage, V")] = None
    heating_pct: Annotated[Measured | None, _maybe("rise of the thermal level, %")] = None
    own: Annotated[Mapping[str, Row], _if_any("stored by the starter of this start, by code")] = _empty()
    outliers: Annotated[int, _if_any("impossible readings of the current, left out")] = 0
    is_baseline: Annotated[bool, says("whether later starts are compared with it")] = False
    drift: Annotated[
        Mapping[str, QuantityChange], _if_any("the last starts and the baseline, by quantity")
    ] = _empty()
    samples: Annotated[Samples, says("columns of the same length; null where a reply did not hold it")] = (
        _empty()
    )


@dataclass(frozen=True, slots=True)
class ReadingTable:
    """Readings by moment.

    Between two equal values a null means the same value: repeated readings of it are not stored.
    """

    t_s: Annotated[tuple[float, ...], says("time from the trip, s")]
    points: Annotated[Mapping[str, tuple[Number | None, ...]], says("columns of the same length, by point")]
    constant: Annotated[Mapping[str, Number], says("points that did not change, by point")]


class TripRecord(_StoredRecord, topic="starter/{starter}/trip", retain=False):
    """One trip: what was read before it, and what the starter says of it."""

    id: Annotated[str, says("names the trip")]
    time_s: Annotated[PossibleTime, says("the first reading that showed it", alias="time")]
    boot: Boot
    seq: Seq
    code: Annotated[str, says("code of the fault, in lower case; `fault`: it has no number")]
    text: Annotated[str, says("its name in the manual")]
    state_before: Annotated[str | None, says("null: found at the first reading")]
    readings: Annotated[ReadingTable, says("the readings before it")]
    at_fault: Annotated[Mapping[str, Row], says("stored by the starter at the fault, by code")]
    fault_history: Annotated[tuple[Row, ...], says("the starter's own list, the newest first")]
    thinned: Annotated[str, _maybe("what was left out, for at most 16 KB")] = ""


class LineRecord(Record, topic="gateway/line/{line}", qos=0, beside="data"):
    """The statistics of a line, every 30 s and on change."""

    line: InTopic
    data: Annotated[Mapping[str, Any], _described_by(LineStatistics), _beside("all counters and times")]


class OutboxRecord(Record, topic="gateway/outbox", qos=0):
    """What waits for the broker, every 30 s and on loss."""

    depth: Annotated[int, says("messages that wait")]
    oldest_s: Annotated[float, says("age of the oldest, s")]
    bytes: Annotated[int, says("size of what waits, B")]
    dropped: Annotated[int, says("messages that were lost")]
    refused: Annotated[int, says("messages that the broker refused")]
    reconnects: Annotated[int, says("connections after the first")]


class StatusRecord(Record, topic="gateway/status"):
    """Whether the gateway works. `offline` is also the will, whose times are null."""

    state: Annotated[GatewayState, says("its state")]
    time_s: Annotated[PossibleTime, says("when this was published", alias="time")]
    boot: Annotated[str, says("names this connection; a command that carries another one is refused")]
    since_s: Annotated[PossibleTime, says("since when it is in this state", alias="since")]
    reason: Annotated[str | None, says("why it is degraded or offline")]
    run: Boot


class FreshRecord(Record, topic="gateway/fresh", qos=0):
    """Every second, and with each stop: the proof of freshness that a command echoes."""

    token: Annotated[str, says("for the `token` of a command")]
    time_s: Annotated[Time, says("when it was issued", alias="time")]


@dataclass(frozen=True, slots=True)
class Operator:
    """What one client may ask of the starters that match."""

    client: Annotated[str, says("the level in the command topic")]
    may: Annotated[tuple[str, ...], says("verbs; * for all")]
    starters: Annotated[tuple[str, ...], says("names, with * and ? as in a shell")]
    freshness: Annotated[Literal["token", "issued_at"], says("what proves its commands fresh")] = "token"


class GatewayRecord(Record, topic="gateway/info"):
    """What this gateway is."""

    product: Annotated[Literal["starter-gateway"], says("this text")] = "starter-gateway"
    version: Annotated[str, says("its version")]
    contract: Annotated[int, says("version of what this page describes")] = CONTRACT_VERSION
    boot: Boot
    mqtt_version: Annotated[MqttVersion, says("of the connection; null before the first")] = None
    starters: Annotated[tuple[str, ...], says("names")]
    lines: Annotated[tuple[str, ...], says("names")]
    operators: Annotated[tuple[Operator, ...], says("who may do what")]
    notice: Annotated[Literal["not a safety function"], _WARNING] = "not a safety function"
    groups: Annotated[Mapping[str, tuple[str, ...]], _if_any("members of each group, by its name")] = _empty()
    line_titles: Annotated[
        Mapping[str, str], _if_any("names for people, of the lines that have one, by name")
    ] = _empty()
    group_titles: Annotated[
        Mapping[str, str], _if_any("names for people, of the groups that have one, by name")
    ] = _empty()


class ForgetRecord(Record, retain=False):
    """Not published: starters and lines that are gone or replaced, of which nothing stays retained."""

    starters: tuple[str, ...] = ()
    lines: tuple[str, ...] = ()

    def has(self, topic: str) -> bool:
        """Return whether a topic below the base is one of theirs."""
        branches = tuple(f"starter/{name}/" for name in self.starters)
        return topic.startswith(branches) or topic in [LineRecord.topic_of(line=name) for name in self.lines]


@dataclass(frozen=True, slots=True)
class HistoryItem:
    """A value that could not be sent when it was new."""

    point: Annotated[str, says("the point")]
    value: Annotated[bool | int | float | str | None, says("its value")]
    quality: Trust
    time_s: Annotated[PossibleTime, says("when the reply left the wire", alias="time")]
    seq: Seq


class HistoryRecord(StarterRecord, topic="starter/{starter}/history", retain=False, is_droppable=True):
    """Values that could not be sent when they were new, at most 200 in a message, the oldest first."""

    boot: Annotated[str, says("the run that they were read in")]
    items: Annotated[Sequence[bytes], _described_by(list[HistoryItem]), says("the oldest first")]

    def payload(self) -> bytes:
        """Return the items, which are JSON already, as one JSON object."""
        return b'{"boot":%b,"items":[%b]}' % (encoded(self.boot), b",".join(self.items))


def history_item(record: ValueRecord) -> bytes:
    """Return a value as JSON, in the form of an item of the history."""
    item = HistoryItem(record.point, record.value, record.quality, record.time_s, record.seq)
    return encoded(item, HistoryItem)
