"""JSON as the contract wants it published: floats with a decimal part, never NaN, times in RFC 3339."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from json.encoder import encode_basestring
from typing import Any


def to_json(value: Any) -> str:
    """Return compact JSON; what JSON cannot say becomes null (NaN, infinity) or its text."""
    kind = type(value)
    if kind is str:  # most are, and nearly all the rest are floats
        return encode_basestring(value)
    if kind is float:
        return _float(value)
    match value:
        case None:
            return "null"
        case bool():
            return "true" if value else "false"
        case int():
            return int.__repr__(value)
        case float():
            return _float(value)
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


def rfc3339(time_s: float | None) -> str | None:
    """Return seconds since 1970 as `2026-11-21T01:02:03.456Z`; None when unknown or beyond the calendar."""
    if time_s is None or not math.isfinite(time_s):
        return None
    try:
        moment = datetime.fromtimestamp(round(time_s, 3), UTC)
    except (ValueError, OverflowError, OSError):
        return None
    return moment.replace(tzinfo=None).isoformat(timespec="milliseconds") + "Z"


def _float(value: float) -> str:
    if not math.isfinite(value):
        return "null"
    text = float.__repr__(value)
    if "e" not in text:
        return text
    mantissa, exponent, power = text.partition("e")
    if "." not in mantissa:
        mantissa += ".0"  # 1e+16, which some clients would take for an integer tag
    return f"{mantissa}{exponent}{power}"
