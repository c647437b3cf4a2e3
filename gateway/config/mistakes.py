"""A mistake in a configuration: its key, what is wrong, and a hint; `load` adds the line in the file.

Pydantic finds wrong values, rules find values that contradict others. A wrong value is taken out of its table
(`ConfigTable.forget`): a rule that reads it cannot be judged, all others are.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from datetime import date, time

from pydantic_core import PydanticCustomError

Key = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class Mistake:
    """What is wrong with one key, and how to correct it."""

    key: Key
    what: str
    hint: str = ""


class WrongValueError(Exception):
    """A rule has read a value that is wrong, and was taken out of its table."""


WHERE_RIGHT = suppress(WrongValueError)  # around a rule: it is judged where all that it reads is right


def wrong(what: str, hint: str) -> PydanticCustomError:
    """Return the error of a value, with a hint."""
    return PydanticCustomError("wrong", "{what}", {"what": what, "hint": hint})


def short(value: object) -> str:
    """Return a foreign value for a message: quoted, and cut when it is long."""
    if isinstance(value, bool):
        return str(value).lower()
    text = str(value) if isinstance(value, (date, time)) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def spell(key: Key) -> str:
    """Return a path as people write it: line[0].starter[2].address."""
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def choose(wrong: object, known: Iterable[str], *, otherwise: str = "") -> str:
    """Return the hint for an unknown word: the nearest known one; else `otherwise`, or all of them."""
    spelt = {word.lower(): word for word in known}
    near = difflib.get_close_matches(str(wrong).lower(), spelt, n=2)
    near = [spelt[word] for word in (near[:1] if str(wrong).lower() in near[:1] else near)]
    if near:
        return f"did you mean {' or '.join(near)}?"
    return otherwise or "one of " + ", ".join(spelt.values())
