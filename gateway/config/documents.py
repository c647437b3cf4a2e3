"""What the rules across tables look into: the document as parsed, whatever stands in it.

A value of the wrong type counts as none: it is a mistake of its own, which the models find.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from gateway.config.mistakes import Mistake, short, spell
from gateway.config.toml_lines import Key

Document = Mapping[str, Any]


def lines_in(document: Document) -> Iterator[tuple[Key, Document]]:
    """Yield the lines with their keys."""
    for index, line in enumerate(list_in(document, "line")):
        if isinstance(line, Mapping):
            yield ("line", index), line


def starters_in(document: Document) -> Iterator[tuple[Key, Document]]:
    """Yield the starters of all lines with their keys."""
    for key, line in lines_in(document):
        yield from starters_of(key, line)


def starters_of(key: Key, line: Document) -> Iterator[tuple[Key, Document]]:
    """Yield a line's starters with their keys."""
    for index, starter in enumerate(list_in(line, "starter")):
        if isinstance(starter, Mapping):
            yield (*key, "starter", index), starter


def table_in(document: Document, name: str) -> Document:
    """Return a table; an empty one for none."""
    table = document.get(name)
    return table if isinstance(table, Mapping) else {}


def list_in(document: Document, name: str) -> list[Any]:
    """Return a list; an empty one for none."""
    items = document.get(name)
    return items if isinstance(items, list) else []


def text_in(table: Document, name: str) -> str:
    """Return a text; an empty one for none."""
    text = table.get(name)
    return text if isinstance(text, str) else ""


def again(seen: dict[object, Key], key: Key, value: object, hint: str) -> Iterator[Mistake]:
    """Yield a value that another key has too; `seen` is what came before."""
    if not value or not isinstance(value, str | int):
        return
    if value in seen:
        yield Mistake(key, f"{short(value)} is also {spell(seen[value])}", hint)
    seen.setdefault(value, key)
