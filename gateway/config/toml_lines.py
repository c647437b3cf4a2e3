"""The line of a key in a TOML text: `tomllib` gives no positions, and a mistake needs its line.

Headers and keys are looked for at the beginnings of lines. What is inside a value has the line of its key.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from gateway.config.mistakes import Key
from gateway.errors import Problem

_PART = re.compile(r"""\"(?:[^"\\]|\\.)*"|'[^']*'|[A-Za-z0-9_-]+""")  # of a key
_NAME = rf"(?:{_PART.pattern})(?:\s*\.\s*(?:{_PART.pattern}))*"
_LINE = re.compile(rf"\s*(?:(\[\[?)\s*)?({_NAME})\s*(?(1)\]|=)")  # a header, or a key with its value
_LONG = re.compile(r"""(?s)(\"{3}(?:\\.|.)*?\"{3}|'{3}.*?'{3})|\"(?:\\.|[^\"\\])*\"|'[^'\n]*'|#[^\n]*""")
_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")
_UNCLOSED = ('Expected "', "Unterminated", "Illegal character '\\n'", "Found invalid character '\\n'")
_HINTS = {  # by how the parser's message begins (CPython, Lib/tomllib/_parser.py)
    "Invalid value": 'text goes in quotes: "..."; true and false are small; a number begins with a digit',
    "Expected newline": "one key a line; text goes in quotes; a decimal point is a point: 0.5",
    "Cannot declare": "several go as [[line]], with two brackets; of the others one, with all its keys",
    "Cannot overwrite": "a key is given twice, or as a value and as a table: keep one of them",
    "Expected '='": 'such as name = "mcc1"; several words are no key',
    "Expected ']": "such as [gateway], or [[line]] with two brackets",
    "Unclosed": "commas between, and a bracket or brace at the end",
    "Unescaped": "write \\\\ for a \\, or put the text in single quotes",
    **dict.fromkeys(_UNCLOSED, "close it with the quote it begins with"),
}


def locate(text: str) -> dict[Key, int]:
    """Return the 1-based line of every table, and of every key that begins a line."""
    lines: dict[Key, int] = {}
    counts: dict[Key, int] = {}  # items so far of each array of tables, less one
    table: Key = ()
    blank = _LONG.sub(lambda found: "\n" * found[0].count("\n") if found[1] else found[0], text)
    for number, line in enumerate(blank.split("\n"), 1):
        if found := _LINE.match(line):
            brackets, parts = found[1], _PART.findall(found[2])
            key = () if brackets else table
            for place, part in enumerate(parts, 1):
                key = (*key, part.strip("\"'"))
                lines.setdefault(key, number)
                if brackets == "[[" and place == len(parts):
                    counts[key] = counts.get(key, -1) + 1
                if key in counts:  # a path through an array of tables goes to its latest item
                    key = (*key, counts[key])
                    lines.setdefault(key, number)
            table = key if brackets else table
    return lines


def line_of(lines: Mapping[Key, int], key: Key) -> int | None:
    """Return the line of the key, or of the nearest table around it; None when the file has neither."""
    return next((lines[key[:n]] for n in range(len(key), 0, -1) if key[:n] in lines), None)


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
