"""JSON as it is read: strictly, since any client may send; `payloads` writes it.

No duplicate keys, NaN, deep nesting or very long integers.
"""

from __future__ import annotations

import json
import math
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
