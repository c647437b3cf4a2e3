"""What a message on a command's topic becomes: a request, a rejection with its reason, or nothing."""

from __future__ import annotations

import json
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from gateway.contract import CommandRequest, Topics
from gateway.mqtt.commands import Incoming, Received, command_in

TOPICS = Topics("b")
START = "b/command/pump-1/alice/start"
STOP = "b/command/pump-1/alice/stop"
NOW_S = 7.0
FRESH = json.dumps({"id": "c1", "token": "t"}).encode()


def received(incoming: Incoming) -> Received | None:
    address = TOPICS.parse_command(incoming.topic)
    return None if address is None else command_in(address, incoming, NOW_S, verb_error=lambda *_: None)


def request_of(incoming: Incoming) -> CommandRequest:
    said = received(incoming)
    assert said is not None
    assert said.refusal is None
    return said.request


def code_of(incoming: Incoming) -> str:
    said = received(incoming)
    assert said is not None
    assert said.refusal is not None
    return said.refusal.code


def test_a_request_has_everything_that_the_message_says() -> None:
    fields: dict[str, Any] = {
        "id": "c1",
        "token": "t",
        "issued_at": "2026-11-21T01:02:03Z",
        "ttl_s": 9,
        "boot": "boot-1",
        "operator": "Ana Pérez",
        "reason": "morning",
        "args": {"parameter": "P314", "value": 30},
        "expect": {"state": "ready"},
        "select": "s",
    }

    request = request_of(
        Incoming(
            "b/command/pump-1/alice/set",
            json.dumps(fields).encode(),
            is_early=True,
            expiry_s=3,
            correlation=b"42",
        )
    )

    assert fields.pop("issued_at")
    assert request == CommandRequest(
        "pump-1",
        "alice",
        "set",
        **fields,
        issued_s=1_795_222_923.0,
        received_s=NOW_S,
        correlation=b"42",
        is_early=True,
        expires_s=10.0,
    )


def test_a_message_whose_own_expiry_has_run_out_is_expired_but_a_stop_is_not() -> None:
    assert code_of(Incoming(START, FRESH, expiry_s=0)) == "expired"
    assert request_of(Incoming(START, FRESH, expiry_s=1)).expires_s == NOW_S + 1
    assert request_of(Incoming(STOP, b"", expiry_s=0)).verb == "stop"


def test_of_a_stop_the_arguments_are_left_out_whatever_they_are() -> None:
    payload = json.dumps({"id": "c1", "operator": "Ana", "args": {"value": 1}, "speed": 3}).encode()

    stop = request_of(Incoming(STOP, payload))

    assert (stop.id, stop.operator, stop.args) == ("c1", "Ana", {})


@given(
    topic=st.sampled_from([START, STOP, "b/command/pump-1/alice/set", "b/audit"]) | st.text(max_size=30),
    payload=st.binary(max_size=300),
    is_retained=st.booleans(),
    expiry_s=st.none() | st.integers(0, 9),
)
def test_random_messages_never_raise_and_only_a_live_stop_gets_through(
    *, topic: str, payload: bytes, is_retained: bool, expiry_s: int | None
) -> None:
    said = received(Incoming(topic, payload, is_retained=is_retained, expiry_s=expiry_s))

    if said is not None and said.refusal is None:
        assert said.request.verb == "stop"
        assert not is_retained
