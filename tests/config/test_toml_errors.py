"""What is no TOML is reported in the parser's words, with its line and a hint."""

from __future__ import annotations

import pytest

from gateway.config.reading import parse
from gateway.errors import ConfigError

BAD = [  # text, line, what it begins with, a part of the hint
    ("[gateway]\nname = \n", 2, "Invalid value, at column 8", "quotes"),
    ("every_s = 0,5\n", 1, "Expected newline", "point"),
    ("a = 1\na = 2\n", 2, "Cannot overwrite a value", "keep one"),
    ("[line]\n[line]\n", 2, "Cannot declare", "several go as [[line]]"),
    ("my name = 1\n", 1, "Expected '='", "several words"),
    ("[[line]\n", 1, "Expected ']]'", "[[line]]"),
    ("a = 'b", 1, "Expected", "quote"),
    ("a = 'b\nc = 'd'\n", 1, "Found invalid character", "quote"),
    ('x = 1\na = "b', 2, "Unterminated string, at the end of the file", "quote"),
    ("a = [1\nb = 2\n", 2, "Unclosed array", "commas"),
    ('a = "C:\\dev"\n', 1, "Unescaped", "single quotes"),
    ('a = "\\ud800"\n', 1, "Escaped character", "toml.io"),
    ("x = 2\na = " + "1" * 5000, None, "Exceeds the limit", "toml.io"),
]


@pytest.mark.parametrize(("text", "line", "what", "hint"), BAD)
def test_what_is_no_toml_is_reported_with_its_line_and_a_hint(
    text: str, line: int | None, what: str, hint: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(text, "site.toml")

    (problem,) = caught.value.problems
    assert problem.line == line
    assert problem.what.startswith(what)
    assert hint in problem.hint
