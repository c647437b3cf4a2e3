"""Errors of TOML syntax: the parser's words with their place, and a hint for what is mistyped most; pure."""

from __future__ import annotations

import re

from gateway.config.schema import REPEATED_TABLES
from gateway.errors import Problem

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
