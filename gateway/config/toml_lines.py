"""The line of a key in a TOML text: `tomllib` gives no positions, and a mistake needs its line.

Each statement, a header or a key with its value, is a document of its own: lines are put together until they
are one. So the parser itself says where a statement ends and which keys it has.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

Key = tuple[str | int, ...]


def locate(text: str) -> dict[Key, int]:
    """Return the 1-based line of every table, key and array item, by its path in the parsed document.

    An item of a list has the line on which it ends; what is inside of it, that of the item.
    """
    lines: dict[Key, int] = {}
    counts: dict[Key, int] = {}  # items so far of each array of tables
    table: Key = ()
    for line, said, ends in _statements(text):
        if ends is None:
            table = _header(said, line, lines, counts)
        else:
            for path in _paths(said):
                own = next((ends[at] for at in path if isinstance(at, int) and at in ends), line)
                lines.setdefault((*table, *path), own)
    return lines


def line_of(lines: Mapping[Key, int], key: Sequence[str | int]) -> int | None:
    """Return the line of the key, or of the nearest table around it; None when the file has neither."""
    return next((lines[tuple(key[:n])] for n in range(len(key), 0, -1) if tuple(key[:n]) in lines), None)


def _statements(text: str) -> Iterator[tuple[int, dict[str, Any], dict[int, int] | None]]:
    """Yield each statement's line, what it says, and of a list the lines of its items; None for a header."""
    begun, statement, ends = 1, "", dict[int, int]()
    for number, line in enumerate(text.replace("\r\n", "\n").split("\n"), 1):
        statement += f"{line}\n"
        said = _parsed(statement)
        if said is None:
            for place in range(len(_items(_parsed(f"{statement}]")))):
                ends.setdefault(place, number)
            continue
        if said:
            for place in range(len(_items(said)) if number > begun else 0):
                ends.setdefault(place, number)
            yield begun, said, None if statement.lstrip().startswith("[") else ends
        begun, statement, ends = number + 1, "", {}


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
