"""What is no TOML is said in our words, with its line, its column and the hint."""

from __future__ import annotations

import inspect
import re
import tomllib
from tomllib import _parser  # type: ignore[attr-defined]  # its source lists its messages

import pytest

from gateway.config.toml_errors import _MEANINGS, syntax_problem

BAD = [  # text, line, what it begins with, a part of the hint
    ("[gateway]\nname = \n", 2, "there is no value after the =, at column 8", "name ="),
    ("a = # none\n", 1, "there is no value after the =", "baud"),
    ("name = mcc1\n", 1, "'mcc1' is no value, at column 8", '"mcc1"'),
    ("enabled = True\n", 1, "True is no value, at column 11", "write true"),
    ("enabled = off\n", 1, "off is no value", "write false"),
    ("every_s = .5\n", 1, "'.5' is no value", "0.5"),
    ("every_s = 0,5\n", 1, "',5' is left over after a number", "point"),
    ("a = 1 b = 2\n", 1, "'b = 2' is left over", "one key a line"),
    ("[gateway] x\n", 1, "'x' is left over", "one key a line"),
    ("a = 1\na = 2\n", 2, "a key is given twice", "keep one"),
    ("a = 1\n[a.b]\n", 2, "a key is given twice, or as a value and as a table", "keep one"),
    ("a = {b = 1, b = 2}\n", 1, "b is given twice", "keep one"),
    ("[mqtt]\n[mqtt]\n", 2, "the table [mqtt] is given twice", "put its keys below the first [mqtt]"),
    ("[line]\n[line]\n", 2, "the table [line] is given twice", "several go as [[line]]"),
    ("[[line]]\n[line]\n", 2, "the table [line] is given twice", "several go as [[line]]"),
    ("[line.starter]\n" * 2, 2, "the table [line.starter] is given twice", "several go as [[line.starter]]"),
    ("[line.starter.rules]\n" * 2, 2, "the table [line.starter.rules] is", "below the first"),
    ("a.b = 1\n[x]\n[a]\n", 3, "the table [a] is given twice", "below the first [a]"),
    ("[a.b]\nc = 1\n[a]\nb.d = 1\n", 4, "a.b is complete", "add the key there"),
    ("a = {b = 1}\na.c = 2\n", 2, "a is complete", "add the key there"),
    ("a = {b = {c = 1}, b.d = 2}\n", 1, "b.d is complete", "add the key there"),
    ("my name = 1\n", 1, "a key has no =, at column 4", "several words"),
    ("name\n", 1, "a key has no =", "name ="),
    ("[[line]\n", 1, "a header [[...]] is not closed, at column 7", "[[line]]"),
    ("[gateway\n", 1, "a header [...] is not closed, at column 9", "[gateway]"),
    ("a = 'b", 1, "a text in quotes is not closed, at the end of the file", "close it"),
    ("a = 'b\nc = 'd'\n", 1, "a text in quotes does not end on its line", "close it"),
    ('a = "b\nc = 1\n', 1, "a text in quotes does not end on its line, at column 7", "close it"),
    ('x = 1\na = "b', 2, "a text in quotes is not closed, at the end of the file", "close it"),
    ('a = """b\n\n', 1, "a text in quotes is not closed", "close it"),
    ("= 1\n", 1, "neither a key nor a header begins like this, at column 1", "a line is"),
    ("!name = 1\n", 1, "neither a key nor a header", "a line is"),
    ("[]\n", 1, "a key is missing", "A-Z"),
    ("a. = 1\n", 1, "a key is missing", "A-Z"),
    ("d = 2026-02-31\n", 1, "there is no such date or time, at column 5", "2026-11-21"),
    ('a = ["x" "y"]\n', 1, "a list is not closed, or a comma is missing", "may ="),
    ("a = [1\nb = 2\n", 2, "a list is not closed", "may ="),
    ("a = {b = 1 c = 2}\n", 1, "a table in braces is not closed", "{ a = 1, b = 2 }"),
    ('a = "C:\\dev"\n', 1, "a \\ in a text in double quotes", "single quotes"),
    ('a = "\\u12"\n', 1, "\\u needs four", "\\u00b0"),
    ('a = "\\ud800"\n', 1, "there is no such character", "toml.io"),
    ('a = "x\u2028y"\nb = .5\n', 2, "'.5' is no value", "0.5"),
    ("a = 'x\x01y'\n", 1, "the character '\\x01' may not stand here, at column 7", "invisible"),
    ("a = 1 # \x02\n", 1, "the character '\\x02' may not stand here", "invisible"),
    ('a = "\x03"\n', 1, "the character '\\x03' may not stand here", "invisible"),
    ("x = 2\na = " + "1" * 5000, 2, "a number has too many digits", "missing"),
]
ENGLISH = re.compile(
    r"invalid|illegal|unterminated|immutable|namespace|unclosed|cannot|unescaped|declare", re.I
)


@pytest.mark.parametrize(("text", "line", "what", "hint"), BAD)
def test_it_says_what_is_wrong_where_and_how_it_is_written(
    text: str, line: int, what: str, hint: str
) -> None:
    problem = syntax_problem(error_of(text), text)

    assert problem.line == line
    assert problem.what.startswith(what)
    assert hint in problem.hint
    assert not ENGLISH.search(problem.what)


def test_every_message_of_the_parser_is_known() -> None:
    source = inspect.getsource(_parser)
    reported = [
        message.replace("\\\\", "\\") for message in re.findall(r'_err\(\s*src, \w+, f?"([^"]+)"', source)
    ]
    known = (
        *_MEANINGS,
        "Cannot declare",
        "Invalid value",
        "Expected newline",
        "Illegal character",
        "Found invalid",
        "Expected {expect",
    )

    assert len(reported) > 15
    assert [message for message in reported if not message.startswith(known)] == []


def error_of(text: str) -> ValueError:
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - which one is what is being tested
        tomllib.loads(text)
    return caught.value
