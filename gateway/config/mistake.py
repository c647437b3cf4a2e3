"""One mistake in a configuration, before its line in the file is known."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import date, time

from gateway.config.locate import Key


@dataclass(frozen=True, slots=True)
class Mistake:
    """What is wrong with one key, and how to mend it."""

    key: Key
    what: str
    mend: str = ""


def spell(key: Key) -> str:
    """Return a path as people write it: line[0].starter[2].address."""
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def choose(wrong: object, known: Iterable[str]) -> str:
    """Return the mend for a word that is none of the known ones: the nearest of them, or all."""
    words = list(dict.fromkeys(known))
    spelt = {word.lower(): word for word in words}
    near = difflib.get_close_matches(str(wrong).lower(), spelt, n=2)
    near = near[:1] if near and near[0] == str(wrong).lower() else near
    near = [spelt[each] for each in near]
    return f"did you mean {' or '.join(near)}?" if near else "one of " + ", ".join(words)


def short(value: object) -> str:
    """Return a foreign value for a message: quoted, and cut when it is long."""
    if isinstance(value, bool):
        return str(value).lower()
    text = str(value) if isinstance(value, (date, time)) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
