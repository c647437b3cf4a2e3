"""Sparkplug B's payload as bytes, and back; pure.

The messages are those of `sparkplug_b.proto` (proto2) as far as a node without templates and data sets needs
them: the numbers of its fields are the contract [Sparkplug 3.0, 6.4]. What else a host sends is skipped.
The descriptors are built here, so nothing is generated.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError

Value = bool | int | float | str | None
FALSE = False

_MESSAGES: Mapping[str, tuple[str, ...]] = {
    "PropertyValue": (
        *("type 1 uint32", "is_null 2 bool", "int_value 3 uint32", "long_value 4 uint64"),
        *("float_value 5 float", "double_value 6 double", "boolean_value 7 bool", "string_value 8 string"),
    ),
    "PropertySet": ("keys 1 string*", "values 2 PropertyValue*"),
    "Metric": (
        *("name 1 string", "alias 2 uint64", "timestamp 3 uint64", "datatype 4 uint32"),
        *("is_historical 5 bool", "is_transient 6 bool", "is_null 7 bool", "properties 9 PropertySet"),
        *("int_value 10 uint32", "long_value 11 uint64", "float_value 12 float", "double_value 13 double"),
        *("boolean_value 14 bool", "string_value 15 string", "bytes_value 16 bytes"),
        *("dataset_value 17 bytes", "template_value 18 bytes", "extension_value 19 bytes"),  # never decoded
    ),
    "Payload": ("timestamp 1 uint64", "metrics 2 Metric*", "seq 3 uint64", "uuid 4 string", "body 5 bytes"),
}


class DataType(enum.IntEnum):
    """Those of the data types that are used here [Sparkplug 3.0, 6.4.16]."""

    INT32 = 3
    INT64 = 4
    DOUBLE = 10
    BOOLEAN = 11
    STRING = 12


_FIELD = {
    DataType.INT32: "int_value",
    DataType.INT64: "long_value",
    DataType.DOUBLE: "double_value",
    DataType.BOOLEAN: "boolean_value",
    DataType.STRING: "string_value",
}
_MASK = {DataType.INT32: 0xFFFF_FFFF, DataType.INT64: 0xFFFF_FFFF_FFFF_FFFF}  # negatives: two's complement
_VARINT, _SIZED = 0, 2  # wire types [Protocol Buffers, Encoding]
_FIXED_SIZES = {1: 8, 5: 4}
MOST_FIELDS = 100  # of a payload that cannot be read as a whole are looked at
_METRICS_KEY = 2 << 3 | _SIZED  # of a payload's metrics
QUALITY = "Quality"
_OTHER_VALUES = (
    *("int_value", "long_value", "float_value", "double_value", "string_value"),
    *("bytes_value", "dataset_value", "template_value", "extension_value"),
)
GOOD, STALE, BAD = 192, 500, 0  # [tck-id-payloads-propertyset-quality-value-value]


@dataclass(frozen=True, slots=True)
class Metric:
    """One value; `time_s` is UTC, seconds since 1970, 0 for none. A value of None is sent as `is_null`."""

    name: str
    datatype: DataType
    value: Value
    time_s: float = 0.0
    quality: int | None = None  # None: not said, which is good
    properties: tuple[tuple[str, str], ...] = ()  # further texts, of a birth


@dataclass(frozen=True, slots=True)
class HostWrite:
    """One metric of a command: what it asks; `time_s` is None when it carries no time of its own."""

    name: str
    is_true: bool  # the Boolean value true is there, whatever else is
    is_plain: bool  # its type is Boolean, or not given, and there is no other value
    time_s: float | None
    is_historical: bool


@dataclass(frozen=True, slots=True)
class HostCommand:
    """An NCMD or DCMD; each metric is looked into when it is asked for, since there may be thousands."""

    time_s: float | None
    metrics: Sequence[Any]
    is_broken: bool = False  # no payload as a whole: these metrics are whole, others may be lost

    def is_asking(self, name: str) -> bool:
        """Return whether any metric of this name is true."""
        return any(_name_of(metric) == name and _is_true(metric) for metric in self.metrics)

    def writes(self, most: int, *, first: str) -> list[HostWrite]:
        """Return so many of the metrics; those of the name `first` that are true before all others."""
        urgent: list[Any] = []
        others: list[Any] = []
        for metric in self.metrics:
            found = urgent if _name_of(metric) == first and _is_true(metric) else others
            if len(found) < most:
                found.append(metric)
        return [_write_of(metric) for metric in (*urgent, *others)[:most]]


def encoded(
    metrics: Iterable[Metric], *, time_s: float, seq: int | None, has_datatypes: bool = True
) -> bytes:
    """Return a payload, its metrics in the order of their times; one without a time has the payload's."""
    payload = _PAYLOAD(timestamp=_ms(time_s))
    for metric in sorted(metrics, key=lambda each: each.time_s or time_s):
        _fill(payload.metrics.add(), metric, time_s=metric.time_s or time_s, has_datatype=has_datatypes)
    if seq is not None:
        payload.seq = seq
    return bytes(payload.SerializeToString(deterministic=True))


def decoded_command(payload: bytes, *, salvaged: bytes = b"") -> HostCommand:
    """Return what a host asks.

    Of what is no payload, the metrics that hold the bytes `salvaged`, up to where it cannot be read on.
    """
    message = _parsed(_PAYLOAD, payload)
    if message is None:
        return HostCommand(None, tuple(_whole_metrics(payload, salvaged)), is_broken=True)
    time_s = message.timestamp / 1000 if message.HasField("timestamp") else None
    return HostCommand(time_s, message.metrics)


def _fill(target: Any, metric: Metric, *, time_s: float, has_datatype: bool) -> None:
    target.name = metric.name
    target.timestamp = _ms(time_s)
    if has_datatype:
        target.datatype = metric.datatype
    if metric.value is None:
        target.is_null = True
    else:
        value = metric.value
        mask = _MASK.get(metric.datatype)
        setattr(target, _FIELD[metric.datatype], value if mask is None else int(value) & mask)
    if metric.quality is None and not metric.properties:
        return
    target.properties.keys.extend(key for key, _ in metric.properties)
    for _, text in metric.properties:
        target.properties.values.add(type=DataType.STRING, string_value=text)
    if metric.quality is not None:
        target.properties.keys.append(QUALITY)
        target.properties.values.add(type=DataType.INT32, int_value=metric.quality)


def _write_of(metric: Any) -> HostWrite:
    is_typed = not metric.HasField("datatype") or metric.datatype == DataType.BOOLEAN
    is_plain = is_typed and not any(metric.HasField(name) for name in _OTHER_VALUES)
    time_s = metric.timestamp / 1000 if metric.HasField("timestamp") else None
    return HostWrite(_name_of(metric), _is_true(metric), is_plain, time_s, metric.is_historical)


def _name_of(metric: Any) -> str:
    """Return a metric's name; one that is no UTF-8 comes as bytes, and is no name that is known here."""
    name = metric.name
    return name if isinstance(name, str) else name.decode("utf-8", "replace")


def _is_true(metric: Any) -> bool:
    return bool(metric.boolean_value and not metric.is_null)


def _parsed(kind: Any, encoded_message: bytes) -> Any:
    """Return a message; None when the bytes are none."""
    message = kind()
    try:
        message.ParseFromString(encoded_message)
    except (DecodeError, UnicodeDecodeError):
        return None
    return message


def _whole_metrics(payload: bytes, holding: bytes) -> Iterator[Any]:
    """Yield the metrics, with these bytes in them, of a payload up to its first field that is none."""
    at = 0
    try:
        for _ in range(MOST_FIELDS):
            if at >= len(payload):
                return
            key, at = _varint(payload, at)
            size = _FIXED_SIZES.get(key & 7)
            if key & 7 == _VARINT:
                _, at = _varint(payload, at)
                continue
            if key & 7 == _SIZED:
                size, at = _varint(payload, at)
            if size is None or at + size > len(payload):
                return
            field = payload[at : at + size]
            at += size
            if key == _METRICS_KEY and holding in field:
                metric = _parsed(_METRIC, field)
                if metric is not None:
                    yield metric
    except IndexError:  # a number that is broken off
        return


def _varint(payload: bytes, at: int) -> tuple[int, int]:
    """Return the number that begins there, and where it ends; IndexError when it does not."""
    number = payload[at]
    if number < 0x80:
        return number, at + 1
    number = 0
    for shift in range(0, 70, 7):
        number |= (payload[at] & 0x7F) << shift
        at += 1
        if payload[at - 1] < 0x80:
            return number, at
    raise IndexError(at)


def _ms(time_s: float) -> int:
    return max(0, round(time_s * 1000))


def _message_classes() -> tuple[Any, Any]:
    file = descriptor_pb2.FileDescriptorProto(name="starter_gateway/sparkplug_b.proto", syntax="proto2")
    file.package = "starter_gateway.sparkplug_b"
    kinds = descriptor_pb2.FieldDescriptorProto
    for name, fields in _MESSAGES.items():
        message = file.message_type.add(name=name)
        for text in fields:
            field, number, kind = text.split()
            is_repeated, kind = kind.endswith("*"), kind.rstrip("*")
            label = kinds.LABEL_REPEATED if is_repeated else kinds.LABEL_OPTIONAL
            entry = message.field.add(name=field, number=int(number), label=label)
            if kind in _MESSAGES:
                entry.type, entry.type_name = kinds.TYPE_MESSAGE, f".{file.package}.{kind}"
            else:
                entry.type = getattr(kinds, f"TYPE_{kind.upper()}")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    names = (f"{file.package}.{name}" for name in ("Payload", "Metric"))
    payloads, metrics = (message_factory.GetMessageClass(pool.FindMessageTypeByName(name)) for name in names)
    return payloads, metrics


_PAYLOAD, _METRIC = _message_classes()
