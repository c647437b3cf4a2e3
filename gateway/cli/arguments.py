"""What people type on a command line, as values."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable

from gateway.errors import UsageError

_CONSTANTS = {"true": True, "false": False}


def whole_number(text: str, what: str, *, low: int, high: int) -> int:
    """Return a decimal or 0x.. number; UsageError when it is none, or outside low..high."""
    try:
        number = int(text, 0)
    except ValueError:
        raise UsageError(f"{what} {text!r} is no number (decimal, or 0x..)") from None
    if not low <= number <= high:
        raise UsageError(f"{what} {text} is out of range ({low}..{high})")
    return number


def arguments(pairs: Iterable[str]) -> dict[str, bool | int | float | str]:
    """Return a command's KEY=VALUE arguments, with numbers, true and false as such; UsageError otherwise."""
    found: dict[str, bool | int | float | str] = {}
    for pair in pairs:
        key, sign, value = pair.partition("=")
        if not sign or not key:
            raise UsageError(f"argument {pair!r} is not KEY=VALUE (e.g. parameter=P314 value=30)")
        if key in found:
            raise UsageError(f"argument {key} stands twice (give it once)")
        found[key] = _value(value)
    return found


def expectations(text: str) -> dict[str, bool | int | float | str]:
    """Return what a command expects, state:ready,remote:true, as values by point; UsageError otherwise."""
    found: dict[str, bool | int | float | str] = {}
    for item in text.split(","):
        name, sign, value = item.partition(":")
        if not sign or not name or not value or name in found:
            raise UsageError(f"expect={text!r} is not POINT:VALUE,.. (e.g. expect=state:ready,remote:true)")
        found[name] = _value(value)
    return found


def _value(text: str) -> bool | int | float | str:
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    with contextlib.suppress(ValueError):
        return int(text, 0)
    with contextlib.suppress(ValueError):
        number = float(text)
        if math.isfinite(number):
            return number
    return text
