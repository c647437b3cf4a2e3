from __future__ import annotations

import tomllib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.config.toml_lines import Key, line_of, locate

TEXT = '''\
# a comment with [brackets] and = signs
title = "x # no comment ] }"   # a comment

[a.b]
c.d = 1
"quoted \\"key\\".\\u00e9" = 2
'single' = [1, [2,
  3],   # "
  4,
]
long = """
[not.a.table]
key = \\""" no end
"""
raw = \'\'\'
x = 1\'\'\'\'
inline = { x = 1, y = { z = [1] } }

[[line]]
name = "one"
[[line.starter]]
name = "p"
[[line.starter]]
name = "q"
  [line.starter.extra]
  k = 1
[[line]]
starter = [
  { name = "r" },
  { name = "s", address = 1 },
]
'''

EXPECTED = {
    ("title",): 2,
    ("a",): 4,
    ("a", "b"): 4,
    ("a", "b", "c"): 5,
    ("a", "b", "c", "d"): 5,
    ("a", "b", 'quoted "key".é'): 6,
    ("a", "b", "single"): 7,
    ("a", "b", "single", 1, 1): 7,  # that of the key that it is in
    ("a", "b", "single", 2): 7,
    ("a", "b", "long"): 11,
    ("a", "b", "raw"): 15,
    ("a", "b", "inline"): 17,
    ("a", "b", "inline", "y", "z", 0): 17,
    ("line",): 19,
    ("line", 0): 19,
    ("line", 0, "name"): 20,
    ("line", 0, "starter", 0): 21,
    ("line", 0, "starter", 1, "name"): 24,
    ("line", 0, "starter", 1, "extra", "k"): 26,
    ("line", 1): 27,
    ("line", 1, "starter"): 28,
    ("line", 1, "starter", 1, "address"): 28,
}


@pytest.mark.parametrize(("key", "line"), EXPECTED.items())
def test_every_kind_of_key_is_found_on_its_line(key: Key, line: int) -> None:
    assert locate(TEXT)[key] == line


def test_every_key_of_the_document_is_found_and_no_other() -> None:
    assert set(locate(TEXT)) == set(keys(tomllib.loads(TEXT)))


def test_a_key_that_is_not_there_stands_where_its_table_begins() -> None:
    lines = locate(TEXT)

    assert line_of(lines, ("line", 0, "starter", 1, "address")) == 23
    assert line_of(lines, ("line", 7)) == 19
    assert line_of(lines, ("nowhere", 1)) is None


NAMES = st.sampled_from(["a", "b", "c-1", '"q.u"', "'r'"])
VALUES = st.recursive(
    st.sampled_from(["1", "-2.5", "true", '"t,]}#"', "'l\"'", "1979-05-27", '"""\nm\n"""', '""']),
    lambda inner: (
        st.lists(inner, max_size=3).map(lambda items: "[\n" + ", # c\n".join(items) + "]")
        | st.dictionaries(NAMES, inner, max_size=2).map(
            lambda table: "{" + ", ".join(f"{key} = {value}" for key, value in table.items()) + "}"
        )
    ),
    max_leaves=5,
)
HEADERS = st.lists(NAMES, min_size=1, max_size=3).map(".".join)
PARTS = st.one_of(
    st.tuples(HEADERS, VALUES).map(lambda pair: f"{pair[0]} = {pair[1]}\n"),
    HEADERS.map(lambda name: f"[{name}]\n"),
    HEADERS.map(lambda name: f"[[ {name} ]] # c\n"),
)


@given(st.lists(PARTS, max_size=8).map("".join))
def test_whatever_the_parser_accepts_is_found(text: str) -> None:
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return

    assert set(locate(text)) == set(keys(document))


def keys(value: Any, path: Key = ()) -> list[Key]:
    """Return the path of everything in a parsed document."""
    if isinstance(value, dict):
        items: list[tuple[str | int, Any]] = list(value.items())
    elif isinstance(value, list):
        items = list(enumerate(value))
    else:
        return []
    return [found for key, item in items for found in ((*path, key), *keys(item, (*path, key)))]
