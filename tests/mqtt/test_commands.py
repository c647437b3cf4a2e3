"""A message as a command: what of it is passed on, and what is never acted on."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.contract import MAX_TTL_S, CommandError, CommandRequest, Proof, Topics, rfc3339
from gateway.mqtt.commands import Incoming, Rejection, command_in
from gateway.starters.policy.freshness import Moment, RunToken, Tokens, decision_of

NOW, NOW_S = "2026-11-21T01:02:03Z", 1_795_222_923.0
ARRIVAL_S = 7.0
START = "b/command/pump-1/alice/start"
STOP = "b/command/pump-1/alice/stop"
WHOLE = {
    "id": "c1",
    "issued_at": NOW,
    "ttl_s": 3,
    "boot": "boot-1",
    "operator": "Ana Pérez",
    "reason": "morning",
    "args": {"parameter": "P314", "value": 30},
}


def read(topic: str, payload: bytes, **flags: bool | int) -> CommandRequest | Rejection | None:
    return command_in(Topics("b"), Incoming(topic, payload, **flags), ARRIVAL_S)  # type: ignore[arg-type]


def test_a_complete_command_is_passed_on_with_everything_it_says() -> None:
    own = Incoming(
        START.replace("start", "set"),
        json.dumps(WHOLE).encode(),
        expiry_s=4,
        response_topic="b/result/pump-1/alice",
        correlation=b"42",
    )

    assert command_in(Topics("b"), own, ARRIVAL_S) == CommandRequest(
        starter="pump-1",
        client="alice",
        verb="set",
        id="c1",
        args={"parameter": "P314", "value": 30},
        operator="Ana Pérez",
        reason="morning",
        received_s=ARRIVAL_S,
        correlation=b"42",
        response_topic="b/result/pump-1/alice",
        proof=Proof(issued_s=NOW_S, boot="boot-1", ttl_s=3),
        expires_s=ARRIVAL_S + 4,
    )


def test_a_response_topic_elsewhere_is_ignored() -> None:
    elsewhere = Incoming(START, b'{"id":"c1"}', response_topic="b/result/pump-1/bob")
    request = command_in(Topics("b"), elsewhere, ARRIVAL_S)

    assert isinstance(request, CommandRequest)
    assert request.response_topic is None


@pytest.mark.parametrize(
    ("payload", "code", "text"),
    [
        (b"", "bad_json", "empty payload"),
        (b"x" * 4097, "too_big", "4097 bytes, at most 4096"),
        (b'{"' + b"k" * 300 + b'":1}', "bad_payload", "kkkk"),
        (b'{"a\\u0007":1}', "bad_payload", "a? is no known key"),
        (b'{"id":7}', "bad_payload", "id must be a text in quotes"),
        (b'{"id":"a\\n"}', "bad_payload", "id must have printable characters only"),
        (b'{"id":"a","ttl_s":true}', "bad_payload", "ttl_s must be"),
        (b'{"id":"a","issued_at":"2026-13-21T01:02:03Z"}', "bad_payload", "issued_at"),
        (b'{"id":"a","issued_at":"\xd9\xa2026-11-21T01:02:03Z"}', "bad_payload", "issued_at"),
    ],
)
def test_a_payload_that_cannot_be_read_is_refused_with_its_reason(
    payload: bytes, code: str, text: str
) -> None:
    rejection = read(START, payload)

    assert isinstance(rejection, Rejection)
    assert rejection.error.code == code
    assert text in rejection.error.text
    assert len(rejection.error.text) <= 200
    assert rejection.error.text.isprintable()


def test_a_message_whose_own_expiry_has_run_out_is_expired() -> None:
    rejection = read(START, b'{"id":"c1"}', expiry_s=0)

    assert isinstance(rejection, Rejection)
    assert rejection.error.code == "expired"


@given(st.binary(max_size=5000), st.booleans())
def test_nothing_in_a_payload_holds_up_a_live_stop(payload: bytes, is_retained: bool) -> None:
    request = read(STOP, payload, is_retained=is_retained, is_live=True, expiry_s=0)

    assert isinstance(request, CommandRequest)
    assert (request.verb, request.args, bool(request.remark)) == ("stop", {}, is_retained)


@given(
    fields=st.dictionaries(
        st.sampled_from(["token", "ttl_s", "boot", "operator", "reason", "args", "x"]),
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=70) | st.just({}),
    ),
    age_s=st.floats(MAX_TTL_S + 0.001, 1e9) | st.floats(-1e9, -2.001),
    is_retained=st.booleans(),
)
def test_no_stale_or_retained_start_is_ever_taken(
    fields: dict[str, object], age_s: float, is_retained: bool
) -> None:
    body = {"id": "c1", **fields, "issued_at": rfc3339(NOW_S - age_s)}
    request = read(START, json.dumps(body).encode(), is_retained=is_retained)
    if isinstance(request, CommandRequest):
        tokens, moment = Tokens(RunToken("boot-1")), Moment(ARRIVAL_S, NOW_S)
        with pytest.raises(CommandError):
            decision_of(request.proof, verb="start", freshness=("token",), tokens=tokens, moment=moment)
    else:
        assert isinstance(request, Rejection)
