"""The line of a key in a TOML text: `tomllib` gives no positions, and a mistake needs its line.

Each statement, a header or a key with its value, is a document of its own: lines are put together until they
are one. So the parser itself says where a statement ends and which keys it has. An error of syntax has the
parser's words with their place, and a hint for what is mistyped most.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from gateway.config.schema import REPEATED_TABLES
from gateway.errors import Problem

Key = tuple[str | int, ...]

_MAY_END = re.compile(r"""\]|\"{3}|'{3}""")  # a statement of several lines is at its end

_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")
_LONG_NUMBER = re.compile(r"[0-9_]{1000,}")
_QUOTES = "close it with the quote it begins with"
_HINTS = {  # by how the parser's message begins (CPython, Lib/tomllib/_parser.py)
    "Invalid value": 'text goes in quotes: "..."; true and false are small; a number begins with a digit',
    "Expected newline": "one key a line; text goes in quotes; a decimal point is a point: 0.5",
    "Cannot overwrite": "a key is given twice, or as a value and as a table: keep one of them",
    "Duplicate inline": "keep one of them",
    "Expected '='": 'such as name = "mcc1"; several words are no key',
    "Expected ']": "such as [gateway], or [[line]] with two brackets",
    'Expected "': _QUOTES,
    "Unterminated": _QUOTES,
    "Invalid initial": "a key has only A-Z, a-z, 0-9, _ and -",
    "Invalid statement": "a line is name = value, a [header] or a # comment",
    "Unclosed array": 'commas between, and a bracket at the end: may = ["start", "stop"]',
    "Unclosed inline": "commas between, and a brace at the end: { a = 1, b = 2 }",
    "Unescaped": "write \\\\ for a \\, or put the text in single quotes",
    "Illegal character '\\n'": _QUOTES,
    "Found invalid character '\\n'": _QUOTES,
    "Illegal character": "remove it; it may be invisible in an editor",
    "Found invalid": "remove it; it may be invisible in an editor",
}


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


def syntax_problem(error: ValueError, text: str) -> Problem:
    """Return what the parser's error says of this text."""
    message = str(error)
    place = _PLACE.search(message)
    what = _PLACE.sub("", message)
    if place is None:  # of int(), which knows no place
        found = _LONG_NUMBER.search(text)
        line = None if found is None else text.count("\n", 0, found.start()) + 1
        return Problem("syntax", "a number has too many digits", "is something missing in between?", line)
    line = int(place[1]) if place[1] else text.rstrip("\n").count("\n") + 1
    where = f"at column {place[2]}" if place[2] else "at the end of the file"
    hint = next((hint for begins, hint in _HINTS.items() if what.startswith(begins)), "see https://toml.io")
    if what.startswith("Cannot declare"):
        name = ".".join(re.findall(r"'([^']*)'", what))
        hint = f"several go as [[{name}]]" if name in REPEATED_TABLES else f"one [{name}] with all its keys"
    return Problem("syntax", f"{what}, {where}", hint, line)
