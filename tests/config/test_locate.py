from __future__ import annotations

import pytest

from gateway.config.toml_lines import Key, line_of, locate

TEXT = """\
# a comment with [brackets] and = signs
title = "x # no comment ] }"   # a comment

[a.b]
c.d = 1
"C8.2.5.3" = 2
'single' = [1, [2,
  3],   # "
  4,
]
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
"""

EXPECTED = {
    ("title",): 2,
    ("a",): 4,
    ("a", "b"): 4,
    ("a", "b", "c"): 5,
    ("a", "b", "c", "d"): 5,
    ("a", "b", "C8.2.5.3"): 6,
    ("a", "b", "single"): 7,
    ("a", "b", "single", 1, 1): 7,  # that of the key that it is in
    ("a", "b", "single", 2): 7,
    ("a", "b", "inline"): 11,
    ("a", "b", "inline", "y", "z", 0): 11,
    ("line",): 13,
    ("line", 0): 13,
    ("line", 0, "name"): 14,
    ("line", 0, "starter", 0): 15,
    ("line", 0, "starter", 1, "name"): 18,
    ("line", 0, "starter", 1, "extra", "k"): 20,
    ("line", 1): 21,
    ("line", 1, "starter"): 22,
    ("line", 1, "starter", 1, "address"): 22,
}


@pytest.mark.parametrize(("key", "line"), EXPECTED.items())
def test_every_kind_of_key_is_found_on_its_line_or_on_that_of_what_it_is_in(key: Key, line: int) -> None:
    assert line_of(locate(TEXT), key) == line


def test_a_key_that_is_nowhere_has_no_line() -> None:
    assert line_of(locate(TEXT), ("nowhere", 1)) is None
