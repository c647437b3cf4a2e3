"""The line of a key in a TOML text: `tomllib` gives no positions, and a mistake needs its line.

Each statement, a header or a key with its value, is a document of its own: lines are put together until they
are one. So the parser itself says where a statement ends and which keys it has.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any

from gateway.config.mistakes import Key
from gateway.errors import Problem

_MAY_END = re.compile(r"""\]|\"{3}|'{3}""")  # a statement of several lines is at its end
_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")
_QUOTES = "close it with the quote it begins with"
_HINTS = {  # by how the parser's message begins (CPython, Lib/tomllib/_parser.py)
    "Invalid value": 'text goes in quotes: "..."; true and false are small; a number begins with a digit',
    "Expected newline": "one key a line; text goes in quotes; a decimal point is a point: 0.5",
    "Cannot declare": "several go as [[line]], with two brackets; of the others one, with all its keys",
    "Cannot overwrite": "a key is given twice, or as a value and as a table: keep one of them",
    "Expected '='": 'such as name = "mcc1"; several words are no key',
    "Expected ']": "such as [gateway], or [[line]] with two brackets",
    'Expected "': _QUOTES,
    "Unterminated": _QUOTES,
    "Illegal character '\\n'": _QUOTES,
    "Found invalid character '\\n'": _QUOTES,
    "Unclosed": "commas between, and a bracket or brace at the end",
    "Unescaped": "write \\\\ for a \\, or put the text in single quotes",
}


def locate(text: str) -> dict[Key, int]:
    """Return the 1-based line of every table and key; what is inside a value has the line of its key."""
    lines: dict[Key, int] = {}
    counts: dict[Key, int] = {}  # items so far of each array of tables
    table: Key = ()
    for line, said, is_header in _statements(text):
        if is_header:
            table = ()
            while said:
                (part, said), *_ = said.items()
                table = (*table, part)
                lines.setdefault(table, line)
                if isinstance(said, list):
                    counts[table] = counts.get(table, -1) + 1
                    said = said[0]
                if table in counts:  # a path through an array of tables goes to its latest item
                    table = (*table, counts[table])
                    lines.setdefault(table, line)
        else:
            for path in _paths(said):
                lines.setdefault((*table, *path), line)
    return lines


def line_of(lines: Mapping[Key, int], key: Key) -> int | None:
    """Return the line of the key, or of the nearest table around it; None when the file has neither."""
    return next((lines[key[:n]] for n in range(len(key), 0, -1) if key[:n] in lines), None)


def _statements(text: str) -> Iterator[tuple[int, dict[str, Any], bool]]:
    """Yield the line on which each statement begins, what it says, and whether it is a header."""
    begun, statement = 1, list[str]()
    for number, line in enumerate(text.replace("\r\n", "\n").split("\n"), 1):
        statement.append(line)
        if len(statement) > 1 and not _MAY_END.search(line):
            continue
        try:
            said = tomllib.loads("\n".join(statement))
        except (ValueError, RecursionError):
            continue
        if said:
            yield begun, said, statement[0].lstrip().startswith("[")
        begun, statement = number + 1, []


def _paths(value: Any) -> Iterator[Key]:
    """Yield the path of everything in a value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield (key,)
        yield from ((key, *path) for path in _paths(item))


def syntax_problem(error: ValueError, text: str) -> Problem:
    """Return what the parser's error says of this text, in its words, with a hint for the usual slips."""
    message = str(error)
    place, what = _PLACE.search(message), _PLACE.sub("", message)
    hint = next((hint for begins, hint in _HINTS.items() if what.startswith(begins)), "see https://toml.io")
    if place is None:  # of int(), which knows no place
        return Problem("syntax", what, hint)
    if place[1] is None:
        return Problem("syntax", f"{what}, at the end of the file", hint, text.rstrip("\n").count("\n") + 1)
    return Problem("syntax", f"{what}, at column {place[2]}", hint, int(place[1]))
