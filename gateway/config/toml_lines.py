"""The line of a key in a TOML text: `tomllib` gives no positions, and a mistake needs its line.

Each statement, a header or a key with its value, is a document of its own: lines are put together until they
are one. So the parser itself says where a statement ends and which keys it has.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

Key = tuple[str | int, ...]

_MAY_END = re.compile(r"""\]|\"{3}|'{3}""")  # a statement of several lines is at its end


def locate(text: str) -> dict[Key, int]:
    """Return the 1-based line of every table, key and array item, by its path in the parsed document.

    What is inside an item of a list has the item's line.
    """
    lines: dict[Key, int] = {}
    counts: dict[Key, int] = {}  # items so far of each array of tables
    table: Key = ()
    for begun, said, statement in _statements(text):
        if statement[0].lstrip().startswith("["):
            table = _header(said, begun, lines, counts)
            continue
        items = _lines_of_items(begun, statement)
        for path in _paths(said):
            place = next((at for at in path if isinstance(at, int)), len(items))
            lines.setdefault((*table, *path), items[place] if place < len(items) else begun)
    return lines


def line_of(lines: Mapping[Key, int], key: Sequence[str | int]) -> int | None:
    """Return the line of the key, or of the nearest table around it; None when the file has neither."""
    return next((lines[tuple(key[:n])] for n in range(len(key), 0, -1) if tuple(key[:n]) in lines), None)


def _statements(text: str) -> Iterator[tuple[int, dict[str, Any], list[str]]]:
    """Yield the line on which each statement begins, what it says, and its own lines."""
    begun, statement = 1, list[str]()
    for number, line in enumerate(text.replace("\r\n", "\n").split("\n"), 1):
        statement.append(line)
        if len(statement) > 1 and not _MAY_END.search(line):
            continue
        said = _parsed("\n".join(statement))
        if said is not None:
            if said:
                yield begun, said, statement
            begun, statement = number + 1, []


def _lines_of_items(begun: int, statement: Sequence[str]) -> list[int]:
    """Return the line on which each item of a list begins; a few lines at a time are a list of their own."""
    found: list[int] = []
    first = 0
    for last in range(len(statement)):
        part = "\n".join(statement[first : last + 1])
        said = _parsed(
            ("" if first == 0 else "x = [\n") + part + ("" if last == len(statement) - 1 else "\n]")
        )
        if said is not None:
            found += [begun + first] * len(_items(said))
            first = last + 1
    return found


def _parsed(text: str) -> dict[str, Any] | None:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError):
        return None


def _items(said: Any) -> Sequence[Any]:
    """Return the list that a single key has; an empty one for anything else."""
    while isinstance(said, dict) and len(said) == 1:
        (said,) = said.values()
    return said if isinstance(said, list) else ()


def _header(said: Any, line: int, lines: dict[Key, int], counts: dict[Key, int]) -> Key:
    """Return the table that a header begins; a path through an array of tables goes to its latest item."""
    table: Key = ()
    while said:
        (part, said), *_ = said.items()
        table = (*table, part)
        if isinstance(said, list):
            lines.setdefault(table, line)
            counts[table] = counts.get(table, 0) + 1
            said = said[0]
        if table in counts:
            table = (*table, counts[table] - 1)
        lines.setdefault(table, line)
    return table


def _paths(value: Any) -> Iterator[Key]:
    """Yield the path of everything in a value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield (key,)
        yield from ((key, *path) for path in _paths(item))
