"""Sparkplug payloads as a host reads and writes them: Protocol Buffers by hand, apart from the product's."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

INT32, INT64, DOUBLE, BOOLEAN, STRING = 3, 4, 10, 11, 12  # data types [Sparkplug 3.0, 6.4.16]


def decoded(payload: bytes) -> dict[str, Any]:
    """Return `timestamp`, `seq`, and the `metrics` by name: their values."""
    names = {1: "timestamp", 3: "seq"}
    said = {names[number]: value for number, value in _fields(payload) if number in names}
    return {"metrics": {each.name: each.value for each in metrics_of(payload)}, **said}


@dataclass(frozen=True)
class SaidMetric:
    """A metric with all that a payload says of it; `kind` is its data type, None where none is given."""

    name: str
    value: Any
    time_ms: int | None
    kind: int | None
    is_null: bool
    has_alias: bool
    properties: Mapping[str, Any]
    property_types: Mapping[str, int]


def metrics_of(payload: bytes) -> list[SaidMetric]:
    """Return the metrics in their order."""
    return [_said(block) for number, block in _fields(payload) if number == 2]


def _said(block: bytes) -> SaidMetric:
    fields = dict(_fields(block))
    keys, values = [], []
    for number, said in _fields(fields.get(9, b"")):
        if number == 1:
            keys.append(said.decode())
        else:
            values.append(dict(_fields(said)))
    return SaidMetric(
        fields.get(1, b"").decode(),
        _value(fields),
        fields.get(3),
        fields.get(4),
        bool(fields.get(7)),
        2 in fields,
        {key: each[8].decode() if 8 in each else each[3] for key, each in zip(keys, values, strict=True)},
        {key: each[1] for key, each in zip(keys, values, strict=True)},
    )


def encoded(metrics: Mapping[str, bool | str], *, time_s: float) -> bytes:
    """Return the payload of a command: `{"Command/Stop": True}`."""
    time_ms = round(time_s * 1000)
    return block_of({1: time_ms}) + b"".join(
        block_of({2: block_of({1: name, 3: time_ms, **_written(value)})}) for name, value in metrics.items()
    )


def block_of(fields: Mapping[int, int | str | bytes]) -> bytes:
    """Return the fields of a message: numbers, texts and blocks."""
    return b"".join(
        _number(number, int(said))
        if isinstance(said, int)
        else _block(number, said.encode() if isinstance(said, str) else said)
        for number, said in fields.items()
    )


def _value(fields: Mapping[int, Any]) -> Any:
    number = next((each for each in range(10, 16) if each in fields), 0)
    said = fields.get(number)
    match number:
        case 10 if fields.get(4) == INT32 and said >= 1 << 31:
            return said - (1 << 32)
        case 13:
            return struct.unpack("<d", said)[0]
        case 14:
            return bool(said)
        case 15:
            return said.decode()
    return said


def _written(value: bool | str) -> dict[int, int | str]:
    return {4: BOOLEAN, 14: int(value)} if isinstance(value, bool) else {4: STRING, 15: value}


def _fields(block: bytes) -> Iterator[tuple[int, Any]]:
    """Yield each field's number and its value: a number, or bytes."""
    at = 0
    while at < len(block):
        key, at = _read_varint(block, at)
        size = {1: 8, 5: 4}.get(key & 7)
        if key & 7 == 0:
            value, at = _read_varint(block, at)
            yield key >> 3, value
            continue
        if size is None:
            size, at = _read_varint(block, at)
        yield key >> 3, block[at : at + size]
        at += size


def _read_varint(block: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        value |= (block[at] & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if block[at - 1] < 0x80:
            return value, at


def _varint(value: int) -> bytes:
    head = bytearray()
    while value >= 0x80:
        head.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes((*head, value))


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _block(field: int, content: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(content)) + content
