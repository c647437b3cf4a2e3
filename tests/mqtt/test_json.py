from __future__ import annotations

import enum
import json
import math
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.contract import Quality, encoded, read_object, rfc3339
from gateway.contract.json_text import MAX_DEPTH

ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(st.characters()),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=12,
)


def refuse_constant(name: str) -> None:
    raise AssertionError(f"{name} in the output")


class Number(enum.IntEnum):
    SEVEN = 7


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "null"),
        (True, "true"),
        (False, "false"),
        (7, "7"),
        (Number.SEVEN, "7"),
        (12.0, "12.0"),
        (-0.5, "-0.5"),
        (1e16, "1.0e+16"),
        (1e-07, "1.0e-7"),
        (1.5e300, "1.5e+300"),
        (math.nan, "null"),
        (math.inf, "null"),
        (-math.inf, "null"),
        ("é\n", '"é\\n"'),
        (Quality.GOOD, '"good"'),
        ((1, 2.0), "[1,2.0]"),
        ({"a": [1], 2: None}, '{"a":[1],"2":null}'),
        (Path("/x"), '"/x"'),
        ("\ud800", '"?"'),
    ],
)
def test_a_value_is_written_as_the_contract_wants_it(value: object, text: str) -> None:
    assert encoded(value).decode() == text


@given(ANYTHING)
def test_whatever_is_written_is_json_without_nan(value: Any) -> None:
    json.loads(encoded(value).decode("utf-8"), parse_constant=refuse_constant)


@pytest.mark.parametrize(
    ("time_s", "text"),
    [
        (0.0, "1970-01-01T00:00:00.000Z"),
        (1_795_222_923.456, "2026-11-21T01:02:03.456Z"),
        (1_795_222_923.9996, "2026-11-21T01:02:04.000Z"),
        (None, None),
        (math.nan, None),
        (math.inf, None),
        (1e18, None),
        (-1e15, None),
    ],
)
def test_times_are_utc_with_milliseconds(time_s: float | None, text: str | None) -> None:
    assert rfc3339(time_s) == text


@given(st.floats())
def test_no_time_raises(time_s: float) -> None:
    text = rfc3339(time_s)

    assert text is None or re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", text)


def test_an_object_is_read_nested_to_the_limit() -> None:
    text = b' {"a": [1, 2.5, "[[[[[[[[[[\\"{{"], "b": {"c": null}} '
    assert read_object(text) == {"a": [1, 2.5, '[[[[[[[[[["{{'], "b": {"c": None}}
    assert read_object(b'{"a":' * MAX_DEPTH + b"1" + b"}" * MAX_DEPTH)


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"", "empty payload"),
        (b" \n", "empty payload"),
        (b"\xff{}", "not UTF-8 at byte 0"),
        (b"\xef\xbb\xbf{}", "not JSON at character 1"),
        (b"stop", "not JSON at character 1: 'stop'"),
        (b"{} {}", "not JSON at character 4: '{}'"),
        (b'{"a":1', "not JSON at character 7: it ends too early"),
        (b"[]", "not a JSON object"),
        (b"3", "not a JSON object"),
        (b'{"a":1,"a":2}', "a key stands twice"),
        (b'{"x":{"a":1,"a":1}}', "a key stands twice"),
        (b'{"a":NaN}', "is NaN or too large"),
        (b'{"a":-Infinity}', "is NaN or too large"),
        (b'{"a":1e999}', "is NaN or too large"),
        (b'{"a":%s}' % (b"9" * 20), "more than 19 digits"),
        (b'{"a":-%s}' % (b"9" * 4000), "more than 19 digits"),
        (b'{"a":%s' % (b"[" * 4000), "nested deeper than 8"),
        (b'{"a":%s%s}' % (b"[" * 500, b"]" * 500), "nested deeper than 8"),
        (b'{"a":' * 9 + b"1" + b"}" * 9, "nested deeper than 8"),
        (b'{"a":["\\ud800"]}', "a lone surrogate"),
        (b'{"\\udfff":1}', "a lone surrogate"),
        (b'{"a":"\x01"}', "not JSON at character 7"),
    ],
)
def test_what_is_no_plain_object_is_refused_with_a_reason(payload: bytes, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        read_object(payload)


@given(st.binary(max_size=200) | st.text().map(lambda text: text.encode("utf-8", "replace")))
def test_random_bytes_are_an_object_or_a_value_error(payload: bytes) -> None:
    try:
        value = read_object(payload)
    except ValueError:
        return
    assert isinstance(value, dict)
