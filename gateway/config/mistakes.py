"""A mistake in a configuration: its key, what is wrong, and a hint; `load` adds the line in the file.

Pydantic finds what is wrong with single values, and is given what the rules of a table find (`refuse`).
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import date, time

from pydantic import ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

Key = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class Mistake:
    """What is wrong with one key, and how to correct it."""

    key: Key
    what: str
    hint: str = ""


def wrong(what: str, hint: str) -> PydanticCustomError:
    """Return the error of a value, with a hint."""
    return PydanticCustomError("wrong", "{what}", {"what": what, "hint": hint})


def refuse(mistakes: Iterable[Mistake]) -> None:
    """Raise ValidationError if there are mistakes in a table; their keys begin below the table's own."""
    details = [InitErrorDetails(type=wrong(m.what, m.hint), loc=m.key, input=None) for m in mistakes]
    if details:
        raise ValidationError.from_exception_data("table", details)


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
