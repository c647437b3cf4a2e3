"""Sparkplug B's payload as bytes, and back; pure.

The messages are those of `sparkplug_b.proto` (proto2) as far as a node without templates and data sets needs
them: the numbers of its fields are the contract [Sparkplug 3.0, 6.4]. All other fields are skipped.
The descriptors are built here, so nothing is generated.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError

Value = bool | int | float | str | None
FALSE = False

_MESSAGES: Mapping[str, tuple[str, ...]] = {
    "PropertyValue": ("type 1 uint32", "int_value 3 uint32", "string_value 8 string"),
    "PropertySet": ("keys 1 string*", "values 2 PropertyValue*"),
    "Metric": (
        # A name as bytes: one that is no UTF-8 does not break the payload, it is unknown.
        *("name 1 bytes", "timestamp 3 uint64", "datatype 4 uint32", "is_historical 5 bool"),
        *("is_null 7 bool", "properties 9 PropertySet", "int_value 10 uint32", "long_value 11 uint64"),
        *(
            "float_value 12 float",
            "double_value 13 double",
            "boolean_value 14 bool",
            "string_value 15 string",
        ),
        *("bytes_value 16 bytes", "dataset_value 17 bytes", "template_value 18 bytes"),  # never decoded
        "extension_value 19 bytes",
    ),
    "Payload": ("timestamp 1 uint64", "metrics 2 Metric*", "seq 3 uint64"),
}


class DataType(enum.IntEnum):
    """Those of the data types that are used here [Sparkplug 3.0, 6.4.16]."""

    INT32 = 3
    INT64 = 4
    DOUBLE = 10
    BOOLEAN = 11
    STRING = 12


_FIELDS = ("int_value", "long_value", "double_value", "boolean_value", "string_value")
_FIELD = dict(zip(DataType, _FIELDS, strict=True))
_MASK = {DataType.INT32: 0xFFFF_FFFF, DataType.INT64: 0xFFFF_FFFF_FFFF_FFFF}  # negatives: two's complement
QUALITY = "Quality"
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

    def is_asking(self, name: str) -> bool:
        """Return whether any metric of this name is true."""
        return any(_is_asking(metric, name.encode()) for metric in self.metrics)

    def writes(self, most: int, *, first: str) -> list[HostWrite]:
        """Return so many of the metrics; those of the name `first` that are true before all others."""
        urgent: list[Any] = []
        others: list[Any] = []
        for metric in self.metrics:
            found = urgent if _is_asking(metric, first.encode()) else others
            if len(found) < most:
                found.append(metric)
        return [_write_of(metric) for metric in (*urgent, *others)[:most]]


def encoded(
    metrics: Iterable[Metric], *, time_s: float, seq: int | None, has_datatypes: bool = True
) -> bytes:
    """Return a payload, its metrics in the order of their times; one without a time has the payload's."""
    payload = _PAYLOAD(timestamp=_ms(time_s), seq=seq)
    for metric in sorted(metrics, key=lambda each: each.time_s or time_s):
        mask = _MASK.get(metric.datatype)
        value = int(metric.value) & mask if mask and metric.value is not None else metric.value
        target = payload.metrics.add(
            name=metric.name.encode(),
            timestamp=_ms(metric.time_s or time_s),
            datatype=metric.datatype if has_datatypes else None,
            **({"is_null": True} if value is None else {_FIELD[metric.datatype]: value}),
        )
        for key, text in metric.properties:
            target.properties.keys.append(key)
            target.properties.values.add(type=DataType.STRING, string_value=text)
        if metric.quality is not None:
            target.properties.keys.append(QUALITY)
            target.properties.values.add(type=DataType.INT32, int_value=metric.quality)
    return bytes(payload.SerializeToString(deterministic=True))


def decoded_command(payload: bytes) -> HostCommand | None:
    """Return what a host asks; None of bytes that are no payload."""
    message = _PAYLOAD()
    try:
        message.ParseFromString(payload)
    except (DecodeError, UnicodeDecodeError):
        return None
    return HostCommand(_time_of(message), message.metrics)


def _write_of(metric: Any) -> HostWrite:
    is_typed = not metric.HasField("datatype") or metric.datatype == DataType.BOOLEAN
    values = [field.name for field, _ in metric.ListFields() if field.name.endswith("_value")]
    return HostWrite(
        metric.name.decode("utf-8", "replace"),
        is_true=_is_true(metric),
        is_plain=is_typed and values in ([], ["boolean_value"]),
        time_s=_time_of(metric),
        is_historical=metric.is_historical,
    )


def _is_asking(metric: Any, name: bytes) -> bool:
    return metric.name == name and _is_true(metric)


def _is_true(metric: Any) -> bool:
    return bool(metric.boolean_value and not metric.is_null)


def _time_of(message: Any) -> float | None:
    return message.timestamp / 1000 if message.HasField("timestamp") else None


def _ms(time_s: float) -> int:
    return max(0, round(time_s * 1000))


def _pool() -> descriptor_pool.DescriptorPool:
    """Return the messages of the table as protobuf knows them."""
    kinds = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(
        name="sparkplug_b.proto", package="sparkplug_b", syntax="proto2"
    )
    for name, fields in _MESSAGES.items():
        message = file.message_type.add(name=name)
        for text in fields:
            field, number, kind = text.split()
            label = kinds.LABEL_REPEATED if kind.endswith("*") else kinds.LABEL_OPTIONAL
            entry = message.field.add(name=field, number=int(number), label=label)
            kind = kind.rstrip("*")
            if kind in _MESSAGES:
                entry.type_name = f".{file.package}.{kind}"
            else:
                entry.type = kinds.Type.Value(f"TYPE_{kind.upper()}")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return pool


_PAYLOAD: Any = message_factory.GetMessageClass(_pool().FindMessageTypeByName("sparkplug_b.Payload"))
