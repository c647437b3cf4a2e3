"""JSON both ways: written by pydantic's own encoder, with what a contract needs besides, and read strictly.

1. Floats have a decimal part and are never NaN or infinite (null instead); text is UTF-8, and a lone
   surrogate, which UTF-8 cannot carry, becomes `?`; what JSON has no form for becomes its text.
2. Any client may send: what is read has no duplicate keys, no NaN, no lone surrogate, no deep nesting and no
   very long integers.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from pydantic import TypeAdapter
from pydantic_core import PydanticSerializationError

MAX_DEPTH = 8
MAX_INT_DIGITS = 19  # enough for 64 bits

_WHOLE_MANTISSA = re.compile(rb"(^|[:,\[])(-?\d)e(?=[-+]?\d)")  # 1e+16: some clients take it for an integer
_STRINGS = re.compile(rb'("(?:[^"\\]|\\.)*")')
_SURROGATE = re.compile("[\ud800-\udfff]")
_TOO_DEEP = f"nested deeper than {MAX_DEPTH}"

adapter_of: Callable[[Any], TypeAdapter[Any]] = cache(TypeAdapter)


def encoded(value: Any, kind: Any = Any) -> bytes:
    """Return a value as compact JSON, in the form that its type describes."""
    serializer = adapter_of(kind).serializer
    try:
        payload = serializer.to_json(value, by_alias=True, fallback=_fallback)
    except PydanticSerializationError:  # a lone surrogate, from the name of a file for instance
        plain = serializer.to_python(value, mode="json", by_alias=True, fallback=_fallback)
        finite = adapter_of(Any).serializer.to_python(plain, mode="json")  # a typed float may be NaN still
        text = json.dumps(finite, ensure_ascii=False, separators=(",", ":"))
        payload = text.encode("utf-8", "replace")
    if b"e+" not in payload and b"e-" not in payload:
        return payload
    pieces = _STRINGS.split(payload)  # texts stay as they are
    return b"".join(each if each[:1] == b'"' else _WHOLE_MANTISSA.sub(rb"\1\2.0e", each) for each in pieces)


def read_object(payload: bytes) -> dict[str, Any]:
    """Return the one JSON object in `payload`; ValueError with the reason when it is none."""
    try:
        text = payload.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"not UTF-8 at byte {error.start}") from error
    if not text.strip():
        raise ValueError("empty payload")
    try:
        value = json.loads(text, object_pairs_hook=_object)
    except json.JSONDecodeError as error:
        rest = text[error.pos : error.pos + 20]
        why = repr(rest) if rest else "it ends too early"
        raise ValueError(f"not JSON at character {error.pos + 1}: {why}") from error
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    if not isinstance(value, dict):
        raise ValueError("not a JSON object")  # noqa: TRY004 - one kind of error for the caller
    _require_plain(value, MAX_DEPTH)
    return value


def _fallback(value: Any) -> Any:
    return dict(value) if isinstance(value, Mapping) else str(value)


def _require_plain(value: object, depth: int) -> None:
    """Raise ValueError for a value that not every program can represent, or nested deeper than `depth`."""
    match value:
        case str() if _SURROGATE.search(value):  # half a pair, which an escape can write
            raise ValueError("a lone surrogate (\\ud800 to \\udfff) is no character")
        case int() if abs(value) >= 10**MAX_INT_DIGITS:
            raise ValueError(f"a whole number has more than {MAX_INT_DIGITS} digits")
        case float() if not math.isfinite(value):
            raise ValueError("a number is NaN or too large")
        case dict() | list() if not depth:
            raise ValueError(_TOO_DEEP)
        case dict() | list():
            for item in (*value, *value.values()) if isinstance(value, dict) else value:
                _require_plain(item, depth - 1)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    seen = dict(pairs)
    if len(seen) != len(pairs):
        raise ValueError("a key stands twice in one object")
    return seen
