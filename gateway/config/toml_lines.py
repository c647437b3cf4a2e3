"""The line of a key in a TOML text: `tomllib` gives no positions, and a mistake needs its line.

The text is one that `tomllib` accepts; only what decides where keys are is understood here.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

Key = tuple[str | int, ...]

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_QUOTED = re.compile(r'"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'')
_LONG = re.compile(r'"""(?:[^\\]|\\.)*?"{3,5}|\'\'\'.*?\'{3,5}', re.DOTALL)
_SCALAR = re.compile(r"[^,\]}#\n]*")
_BLANK = re.compile(r"[ \t]*")
_BLANK_LINES = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
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
    """One pass over a text, from its first character to its last."""

    def __init__(self, text: str) -> None:
        self.lines: dict[Key, int] = {}
        self._text = text
        self._at = 0
        self._line = 1
        self._counts: dict[Key, int] = {}  # items so far of each array of tables

    def document(self) -> None:
        """Note the position of everything."""
        table: Key = ()
        self._take(_BLANK_LINES)
        while self._at < len(self._text):
            if self._peek() == "[":
                table = self._header()
            else:
                self._assignment(table)
            self._take(_BLANK_LINES)

    def _header(self) -> Key:
        is_array = self._text.startswith("[[", self._at)
        line = self._line
        self._skip(2 if is_array else 1)
        parts = self._dotted()
        self._skip(2 if is_array else 1)
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
        line = self._line
        key = table
        for part in self._dotted():
            key = (*key, part)
            self.lines.setdefault(key, line)
        self._skip(1)  # =
        self._take(_BLANK)
        self._value(key)

    def _value(self, key: Key) -> None:
        if self._peek() == "[":
            self._array(key)
        elif self._peek() == "{":
            self._inline_table(key)
        elif not self._take(_LONG) and not self._take(_QUOTED):
            self._take(_SCALAR)

    def _array(self, key: Key) -> None:
        self._skip(1)
        self._take(_BLANK_LINES)
        index = 0
        while self._peek() not in ("]", ""):
            self.lines.setdefault((*key, index), self._line)
            self._value((*key, index))
            index += 1
            self._comma()
        self._skip(1)

    def _inline_table(self, key: Key) -> None:
        self._skip(1)
        self._take(_BLANK_LINES)
        while self._peek() not in ("}", ""):
            self._assignment(key)
            self._comma()
        self._skip(1)

    def _comma(self) -> None:
        self._take(_BLANK_LINES)
        if self._peek() == ",":
            self._skip(1)
        self._take(_BLANK_LINES)

    def _dotted(self) -> list[str]:
        parts = []
        while True:
            self._take(_BLANK)
            quoted = self._take(_QUOTED)
            parts.append(_unquote(quoted) if quoted else self._take(_BARE))
            self._take(_BLANK)
            if self._peek() != ".":
                return parts
            self._skip(1)

    def _peek(self) -> str:
        return self._text[self._at : self._at + 1]

    def _skip(self, count: int) -> None:
        self._at += count

    def _take(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self._text, self._at)
        taken = match.group() if match else ""
        self._at += len(taken)
        self._line += taken.count("\n")
        return taken


def _unquote(quoted: str) -> str:
    body = quoted[1:-1]
    if quoted[0] == "'":
        return body
    return re.sub(r"\\(u[0-9A-Fa-f]{4}|U[0-9A-Fa-f]{8}|.)", _unescape, body)


def _unescape(match: re.Match[str]) -> str:
    escape = match.group(1)
    return chr(int(escape[1:], 16)) if escape[0] in "uU" else _ESCAPES[escape]
