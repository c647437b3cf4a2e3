"""JSON, both ways.

Reading is strict, since any client may send: no duplicate keys, NaN, deep nesting or very long integers.
Writing follows the contract: floats have a decimal part and are never NaN, times are RFC 3339 in UTC.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from json.encoder import encode_basestring
from typing import Any, NoReturn

MAX_DEPTH = 8
MAX_INT_DIGITS = 19  # enough for 64 bits


def read_object(payload: bytes) -> dict[str, Any]:
    """Return the one JSON object in `payload`; ValueError with the reason when it is none."""
    try:
        text = payload.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"not UTF-8 at byte {error.start}") from error
    if not text.strip():
        raise ValueError("empty payload")
    if _depth(text) > MAX_DEPTH:
        raise ValueError(f"nested deeper than {MAX_DEPTH}")
    try:
        value = json.loads(
            text,
            object_pairs_hook=_object,
            parse_constant=_constant,
            parse_int=_int,
            parse_float=_float,
        )
    except json.JSONDecodeError as error:
        raise ValueError(_place(text, error.pos)) from error
    if not isinstance(value, dict):
        raise ValueError("not a JSON object")  # noqa: TRY004 - one kind of error for the caller
    if "\\u" in text:
        _require_characters(value)
    return value


def _place(text: str, position: int) -> str:
    """Return where a text stops being one JSON value."""
    rest = text[position : position + 20]
    return f"not JSON at character {position + 1}: " + (repr(rest) if rest else "it ends too early")


def _require_characters(value: object) -> None:
    """Raise ValueError for half a surrogate pair, which an escape can write: no UTF-8 text holds one."""
    match value:
        case str():
            if any("\ud800" <= sign <= "\udfff" for sign in value):
                raise ValueError("a lone surrogate (\\ud800 to \\udfff) is no character")
        case dict():
            for key, item in value.items():
                _require_characters(key)
                _require_characters(item)
        case list():
            for item in value:
                _require_characters(item)


def _depth(text: str) -> int:
    depth = deepest = 0
    most = text.count("[") + text.count("{")
    if most <= MAX_DEPTH:
        return most  # whatever of it stands in strings
    is_string = is_escaped = False
    for sign in text:
        if is_string:
            is_string = is_escaped or sign != '"'
            is_escaped = sign == "\\" and not is_escaped
        elif sign == '"':
            is_string = True
        elif sign in "[{":
            depth += 1
            deepest = max(deepest, depth)
        elif sign in "]}":
            depth -= 1
    return deepest


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    seen = dict(pairs)
    if len(seen) != len(pairs):
        raise ValueError("a key stands twice in one object")
    return seen


def _constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not JSON")


def _int(text: str) -> int:
    if len(text.lstrip("-")) > MAX_INT_DIGITS:
        raise ValueError(f"a whole number has more than {MAX_INT_DIGITS} digits")
    return int(text)


def _float(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError("a number is too large")
    return value


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
