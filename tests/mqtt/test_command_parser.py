from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.contract import CommandRequest
from gateway.mqtt.commands import Incoming
from tests.mqtt.commands import NOW, START, command, fresh, judge, refusal

STOP = "b/command/pump-1/alice/stop"


def test_a_complete_command_is_passed_on_with_everything_it_says() -> None:
    incoming = command(
        {
            "id": "c1",
            "issued_at": NOW,
            "ttl_s": 5,
            "boot": "boot-1",
            "operator": "Ana Pérez",
            "reason": "morning",
            "args": {"parameter": "P314", "value": 30},
        },
        topic="b/command/pump-1/alice/set",
        correlation=b"42",
        response_topic="b/result/pump-1/alice",
    )

    assert judge(incoming) == CommandRequest(
        starter="pump-1",
        client="alice",
        verb="set",
        id="c1",
        args={"parameter": "P314", "value": 30},
        operator="Ana Pérez",
        reason="morning",
        received_s=7.0,
        correlation=b"42",
        response_topic="b/result/pump-1/alice",
        expires_s=12.0,
        decided_s=5.0,
        decided_by="issued_at",
    )


def test_a_response_topic_elsewhere_is_ignored() -> None:
    judged = judge(command(fresh(), response_topic="b/result/pump-1/bob"))

    assert isinstance(judged, CommandRequest)
    assert judged.response_topic is None


@pytest.mark.parametrize(
    ("payload", "code", "text"),
    [
        (b"", "bad_json", "empty payload"),
        (b"start", "bad_json", "not JSON at character 1: 'start'"),
        (b'{"id":"a","id":"b"}', "bad_json", "a key stands twice"),
        (b'{"ttl_s":NaN}', "bad_json", "NaN is not JSON"),
        (b"x" * 4097, "too_big", "4097 bytes of payload, at most 4096"),
        (b'{"' + b"k" * 300 + b'":1}', "bad_payload", "kkkk"),
        (b'{"a\\u0007":1}', "bad_payload", "a? is no known key"),
        (b'{"id":7}', "bad_payload", "id must be a text in quotes"),
        (b'{"id":"a","ttl_s":9999}', "bad_payload", "ttl_s must be at most"),
    ],
)
def test_a_payload_that_cannot_be_read_is_refused_with_its_reason(
    payload: bytes, code: str, text: str
) -> None:
    rejection = refusal(Incoming(START, payload))

    assert rejection.code == code
    assert text in rejection.text
    assert len(rejection.text) <= 200
    assert rejection.text.isprintable()


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
        {"ttl_s": -1},
        {"ttl_s": 60.1},
        {"issued_at": 1_795_222_923},
        {"issued_at": "2026-11-21T01:02:03"},
        {"issued_at": "2026-11-21"},
        {"issued_at": "2026-13-21T01:02:03Z"},
        {"issued_at": "2026-11-21T01:02:60Z"},
        {"issued_at": "٢026-11-21T01:02:03Z"},
        {"issued_at": f"{NOW}\n"},
        {"issued_at": "now"},
        {"boot": 1},
        {"operator": ["Ana"]},
        {"operator": "x" * 65},
        {"reason": "x" * 257},
        {"reason": "a\x1b[31m"},
        {"args": []},
        {"args": None},
        {"Id": "c1"},
    ],
)
def test_a_field_of_the_wrong_form_is_refused(fields: dict[str, object]) -> None:
    assert refusal(command(fresh(**fields))).code == "bad_payload"


@given(
    topic=st.sampled_from([START, STOP, "b/command/pump-1/alice/set", "b/audit"]) | st.text(max_size=30),
    payload=st.binary(max_size=300),
    is_retained=st.booleans(),
    is_synchronised=st.booleans(),
    expiry_s=st.none() | st.integers(0, 9),
)
def test_random_messages_never_raise_and_only_a_live_stop_gets_through(
    *, topic: str, payload: bytes, is_retained: bool, is_synchronised: bool, expiry_s: int | None
) -> None:
    judged = judge(
        Incoming(topic, payload, is_retained=is_retained, expiry_s=expiry_s),
        clock_is_synchronised=is_synchronised,
    )

    if isinstance(judged, CommandRequest):
        assert judged.verb == "stop"
        assert not is_retained


@pytest.mark.parametrize("freshness", ["token", "issued_at"])
def test_a_command_of_the_page_is_fresh_by_its_token_whatever_counts_over_mqtt(freshness: str) -> None:
    taken = judge(command(fresh(boot="boot-1"), source="web"), freshness=freshness)
    by_boot = refusal(command({"id": "c1", "boot": "boot-1"}, source="web"), freshness=freshness)

    assert isinstance(taken, CommandRequest)
    assert by_boot.code == "not_fresh"
