"""The payload of a command: what is refused, with which reason, and what of a wrong one is understood."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from gateway.contract import CommandBody, CommandError, read_body

NOW = "2026-11-21T01:02:03Z"


def refusal(payload: bytes) -> CommandError:
    _, error = read_body(payload)
    assert error is not None
    return error


@pytest.mark.parametrize(
    ("payload", "code", "text"),
    [
        (b"", "bad_json", "empty payload"),
        (b"start", "bad_json", "not JSON at character 1: 'start'"),
        (b"x" * 4097, "too_big", "has 4097 bytes, at most 4096"),
        (b'{"' + b"k" * 300 + b'":1}', "bad_payload", "kkkk"),
        (b'{"a\\u0007":1}', "bad_payload", "a? is no known key"),
        (b'{"id":7}', "bad_payload", "id must be a text in quotes"),
        (b'{"id":"a","ttl_s":9999}', "bad_payload", "ttl_s must be at most"),
    ],
)
def test_a_payload_that_cannot_be_read_is_refused_with_its_reason(
    payload: bytes, code: str, text: str
) -> None:
    error = refusal(payload)

    assert error.code == code
    assert text in error.text
    assert len(error.text) <= 200
    assert error.text.isprintable()


@pytest.mark.parametrize(
    "fields",
    [
        {"id": 7},
        {"id": ""},
        {"id": "x" * 65},
        {"id": "a\n"},
        {"ttl_s": "5"},
        {"ttl_s": True},
        {"ttl_s": 0},
        {"ttl_s": 60.1},
        {"issued_at": 1_795_222_923},
        {"issued_at": "2026-11-21T01:02:03"},
        {"issued_at": "2026-13-21T01:02:03Z"},
        {"issued_at": "2026-11-21T01:02:60Z"},
        {"issued_at": "٢026-11-21T01:02:03Z"},
        {"issued_at": f"{NOW}\n"},
        {"operator": ["Ana"]},
        {"reason": "x" * 257},
        {"reason": "a\x1b[31m"},
        {"args": []},
        {"expect": "ready"},
        {"Id": "c1"},
    ],
)
def test_a_field_of_the_wrong_form_is_refused(fields: dict[str, object]) -> None:
    assert refusal(json.dumps({"id": "c1", "token": "t", **fields}).encode()).code == "bad_payload"


@pytest.mark.parametrize(
    ("payload", "understood"),
    [
        (b"now!", CommandBody()),
        (b"x" * 4097, CommandBody()),
        (b'{"id":"c1","operator":"Ana","speed":3}', CommandBody(id="c1", operator="Ana")),
        (b'{"id":7,"reason":"hot","args":[1]}', CommandBody(reason="hot")),
    ],
)
def test_of_a_wrong_payload_is_understood_what_can_be(payload: bytes, understood: CommandBody) -> None:
    assert read_body(payload)[0] == understood


def test_a_run_is_ready_for_its_first_command() -> None:
    code = (
        "from gateway.contract import json_text, read_body; built = json_text.adapter_of.cache_info().misses;"
        """read_body(b'{"id":"a"}'); print(json_text.adapter_of.cache_info().misses - built)"""
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert found.stdout == "0\n"
