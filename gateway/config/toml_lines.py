"""The line of a key in a TOML text: `tomllib` gives no positions, and a mistake needs its line.

The text is one that `tomllib` accepts; only what decides where keys are is understood here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

Key = tuple[str | int, ...]

_TOKEN = re.compile(
    r"""(?P<skipped>[ \t\r]+|\#[^\n]*)
    |"{3}(?:[^\\]|\\.)*?"{3,5} | '{3}.*?'{3,5} | "(?:[^"\\\n]|\\.)*" | '[^'\n]*'
    |[^]\s,[{}=.\#"']+
    |.""",
    re.DOTALL | re.VERBOSE,
)
_ENDS = (",", "]", "}", "\n", "")  # what follows a value
_ESCAPES = {'"': '"', "\\": "\\", "b": "\b", "t": "\t", "n": "\n", "f": "\f", "r": "\r"}


def locate(text: str) -> dict[Key, int]:
    """Return the 1-based line of every table, key and array item, by its path in the parsed document."""
    scan = _Scan(text)
    scan.document()
    return scan.lines


def line_of(lines: dict[Key, int], key: Sequence[str | int]) -> int | None:
    """Return the line of the key, or of the nearest table around it; None when the file has neither."""
    for length in range(len(key), 0, -1):
        found = lines.get(tuple(key[:length]))
        if found is not None:
            return found
    return None


class _Scan:
    """One pass over the tokens of a text, from the first to the last, which is empty."""

    def __init__(self, text: str) -> None:
        self.lines: dict[Key, int] = {}
        self._left = [("", 0), *reversed(list(_tokens(text)))]
        self._counts: dict[Key, int] = {}  # items so far of each array of tables

    def document(self) -> None:
        """Note the position of everything."""
        table: Key = ()
        while token := self._first():
            if token == "[":
                table = self._header()
            else:
                self._assignment(table)

    def _header(self) -> Key:
        _, line = self._left.pop()
        is_array = self._peek() == "["
        if is_array:
            self._left.pop()
        parts = self._dotted()
        for _ in range(2 if is_array else 1):
            self._left.pop()
        table: Key = ()
        for index, part in enumerate(parts):
            table = (*table, part)
            if is_array and index == len(parts) - 1:
                self.lines.setdefault(table, line)
                self._counts[table] = self._counts.get(table, 0) + 1
            if table in self._counts:  # a path through an array of tables goes through its latest item
                table = (*table, self._counts[table] - 1)
            self.lines.setdefault(table, line)
        return table

    def _assignment(self, table: Key) -> None:
        line, key = self._left[-1][1], table
        for part in self._dotted():
            key = (*key, part)
            self.lines.setdefault(key, line)
        self._left.pop()  # =
        self._value(key)

    def _value(self, key: Key) -> None:
        opening = self._peek()
        if opening not in ("[", "{"):
            while self._peek() not in _ENDS:
                self._left.pop()
            return
        self._left.pop()
        index = 0
        while self._first() not in ("]", "}"):
            if opening == "{":
                self._assignment(key)
            else:
                self.lines.setdefault((*key, index), self._left[-1][1])
                self._value((*key, index))
                index += 1
            if self._first() == ",":
                self._left.pop()
        self._left.pop()

    def _dotted(self) -> list[str]:
        parts = [_unquote(self._left.pop()[0])]
        while self._peek() == ".":
            self._left.pop()
            parts.append(_unquote(self._left.pop()[0]))
        return parts

    def _peek(self) -> str:
        return self._left[-1][0]

    def _first(self) -> str:
        """Return the next token that is no line's end."""
        while self._peek() == "\n":
            self._left.pop()
        return self._peek()


def _tokens(text: str) -> Iterator[tuple[str, int]]:
    """Yield what is neither blank nor comment, with its line."""
    line = 1
    for match in _TOKEN.finditer(text):
        if match["skipped"] is None:
            yield match[0], line
        line += match[0].count("\n")


def _unquote(word: str) -> str:
    if word[0] == '"':
        return re.sub(r"\\(u[0-9A-Fa-f]{4}|U[0-9A-Fa-f]{8}|.)", _unescape, word[1:-1])
    return word.strip("'")


def _unescape(match: re.Match[str]) -> str:
    escape = match.group(1)
    return chr(int(escape[1:], 16)) if escape[0] in "uU" else _ESCAPES[escape]
