"""Errors of TOML syntax in plain words: what is wrong, at which line and column, and a hint; pure.

`tomllib` has about twenty messages (CPython, Lib/tomllib/_parser.py); in place of one that is not known here
stands a plain sentence.
"""

from __future__ import annotations

import re

from gateway.config.mistakes import short
from gateway.config.schema import REPEATED_TABLES
from gateway.errors import Problem

_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")
_QUOTED = re.compile(r"'([^']*)'")
_LONG_NUMBER = re.compile(r"[0-9_]{1000,}")
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_.:/-]*")
_MANUAL = "see https://toml.io"
_LINE_ENDS = ("'\\n'", "'\\r'")


def syntax_problem(error: ValueError, text: str) -> Problem:
    """Return what the parser's error says of this text."""
    message = str(error)
    if message.startswith("Exceeds the limit"):  # of int(), which knows no place
        found = _LONG_NUMBER.search(text)
        line = None if found is None else text.count("\n", 0, found.start()) + 1
        return Problem("syntax", "a number has too many digits", "is something missing in between?", line)
    place = _PLACE.search(message)
    line, where, rest = None, "", ""
    if place is not None and place[1]:
        line, column = int(place[1]), int(place[2])
        lines = text.replace("\r\n", "\n").split("\n")  # as the parser counts them
        where, rest = f", at column {column}", lines[line - 1][column - 1 :].strip()
    elif place is not None:
        line, where = text.rstrip("\n").count("\n") + 1, ", at the end of the file"
    what, hint = _words(_PLACE.sub("", message), rest)
    return Problem("syntax", f"{what}{where}", hint, line)


def _words(message: str, rest: str) -> tuple[str, str]:
    """Return what is wrong and the hint; `rest` is the line from the error on."""
    if message in ("Invalid value", "Expected newline or end of document after a statement"):
        return _of_value(rest) if message == "Invalid value" else _of_more(rest)
    if message.startswith(_TABLE_TWICE):
        return _of_table(".".join(_QUOTED.findall(message)))
    for beginning, words in _MEANINGS.items():
        if message.startswith(beginning):
            names = ".".join(_QUOTED.findall(message))
            what, hint = words
            return what.format(names=names or "it"), hint.format(names=names or "it")
    if message.startswith(("Illegal character", "Found invalid character")):
        return _of_character(message)
    return "this is not written as TOML", _MANUAL


def _of_value(rest: str) -> tuple[str, str]:
    if not rest or rest.startswith("#"):
        return "there is no value after the =", 'such as name = "mcc1" or baud = 19200'
    word = _WORD.match(rest)
    if word is None:
        return (
            f"{short(rest)} is no value",
            'text goes in quotes: "..."; a decimal number begins with a digit: 0.5',
        )
    if word[0].lower() in ("true", "false", "yes", "no", "on", "off"):
        is_yes = word[0].lower() in ("true", "yes", "on")
        return f"{word[0]} is no value", f"write {str(is_yes).lower()}"
    return f"{short(word[0])} is no value", f'text goes in quotes: "{word[0][:40]}"'


def _of_more(rest: str) -> tuple[str, str]:
    if re.match(r",[0-9]", rest):
        return f"{short(rest)} is left over after a number", "a decimal point is a point: 0.5"
    return f"{short(rest)} is left over after what comes before it on its line", (
        "one key a line; text goes in quotes; a comment begins with #"
    )


def _of_table(name: str) -> tuple[str, str]:
    hint = (
        f"several go as [[{name}]]" if name in REPEATED_TABLES else f"put its keys below the first [{name}]"
    )
    return f"the table [{name}] is given twice", hint


def _of_character(message: str) -> tuple[str, str]:
    character = message.rpartition(" character ")[2]
    if character in _LINE_ENDS:
        return "a text in quotes does not end on its line", "close it with the quote it begins with"
    return f"the character {character} may not stand here", "remove it; it may be invisible in an editor"


_TABLE_TWICE = "Cannot declare"
_TWICE = ("{names} is given twice", "keep one of them")
_CLOSED = ("{names} is complete where it was given first", "add the key there")
_QUOTE = ("a text in quotes is not closed", "close it with the quote it begins with")
_MEANINGS = {  # by how the parser's message begins
    "Cannot overwrite a value": ("a key is given twice, or as a value and as a table", "keep one of them"),
    "Duplicate inline table key": _TWICE,
    "Cannot redefine namespace": _CLOSED,
    "Cannot mutate immutable namespace": _CLOSED,
    "Expected '=' after a key": ("a key has no =", 'such as name = "mcc1"; several words are no key'),
    "Expected ']]'": ("a header [[...]] is not closed", "such as [[line]] or [[line.starter]]"),
    "Expected ']' at": ("a header [...] is not closed", "such as [gateway]"),
    "Expected \"'": _QUOTE,
    "Unterminated string": _QUOTE,
    "Invalid initial character for a key": (
        "a key is missing, or begins with a character that no key has",
        "a key has only A-Z, a-z, 0-9, _ and -",
    ),
    "Invalid statement": (
        "neither a key nor a header begins like this",
        "a line is name = value, a [header] or a # comment",
    ),
    "Invalid date or datetime": ("there is no such date or time", "such as 2026-11-21T10:30:00Z"),
    "Unclosed array": (
        "a list is not closed, or a comma is missing in it",
        'such as may = ["start", "stop"]',
    ),
    "Unclosed inline table": (
        "a table in braces is not closed, or a comma is missing in it",
        "such as {{ a = 1, b = 2 }}",
    ),
    "Unescaped '\\'": (
        "a \\ in a text in double quotes begins a code that does not exist",
        "write \\\\, or put the text in single quotes",
    ),
    "Invalid hex value": ("\\u needs four and \\U eight hexadecimal digits", "such as \\u00b0"),
    "Escaped character": ("there is no such character", _MANUAL),
}
