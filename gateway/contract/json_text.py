"""The one encoder of JSON: pydantic's own, with what a contract needs besides.

Floats have a decimal part and are never NaN or infinite (null instead); text is UTF-8, and a lone surrogate,
which UTF-8 cannot carry, becomes `?`; what JSON has no form for becomes its text.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from pydantic_core import PydanticSerializationError, to_json

_WHOLE_MANTISSA = re.compile(rb"(^|[:,\[])(-?\d)e(?=[-+]?\d)")  # 1e+16: some clients take it for an integer
_STRINGS = re.compile(rb'("(?:[^"\\]|\\.)*")')


def encoded(value: Any) -> bytes:
    """Return a value as compact JSON."""
    try:
        return with_decimals(to_json(value, inf_nan_mode="null", fallback=_fallback))
    except PydanticSerializationError:  # a lone surrogate, from the name of a file for instance
        return with_decimals(to_json(_without_surrogates(value), inf_nan_mode="null", fallback=_fallback))


def with_decimals(payload: bytes) -> bytes:
    """Give numbers such as `1e-7` a decimal part; texts stay as they are."""
    if b"e+" not in payload and b"e-" not in payload:
        return payload
    pieces = _STRINGS.split(payload)
    return b"".join(each if each[:1] == b'"' else _WHOLE_MANTISSA.sub(rb"\1\2.0e", each) for each in pieces)


def _fallback(value: Any) -> Any:
    return dict(value) if isinstance(value, Mapping) else str(value)


def _without_surrogates(value: Any) -> Any:
    match value:
        case str():
            return value.encode("utf-8", "replace").decode()
        case Mapping():
            return {_without_surrogates(key): _without_surrogates(item) for key, item in value.items()}
        case list() | tuple() | set() | frozenset():
            return [_without_surrogates(item) for item in value]
        case _:
            return value
