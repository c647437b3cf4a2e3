"""The simulator's own topics: what is answered, and what is refused."""

from __future__ import annotations

import json
from typing import Any

import pytest

from gateway.cli.demo.simulate import answer_to, simulator_topics
from gateway.errors import UsageError
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.mqtt.contract.commands import Incoming
from gateway.sim.factory import make_unit


def asked(
    topic: str, payload: bytes = b"", *, is_retained: bool = False
) -> tuple[str, dict[str, Any]] | None:
    unit = make_unit("ssw07", 1)
    message = answer_to({"pump": unit}, Incoming(topic, payload, is_retained=is_retained))
    if message is None:
        return None
    return message.topic, {**json.loads(message.payload), "trips": len(unit.trips)}


def test_a_knob_is_turned_and_the_answer_says_what_was_done() -> None:
    assert asked("simulator/pump/trip", b"E05") == (
        "simulator/pump/done",
        {"knob": "trip", "setting": "E05", "text": "tripped: E05", "trips": 1},
    )


def test_an_answer_of_our_own_sets_nothing() -> None:
    assert asked("simulator/pump/done", b"{}") is None


@pytest.mark.parametrize(
    ("topic", "payload", "why"),
    [
        ("simulator/pump/trip", b"\xff\xfe", "no number"),
        ("simulator/pump/explode", b"", "no knob 'explode'"),
        ("simulator/fan/trip", b"", "no simulated starter 'fan' (one of pump)"),
    ],
)
def test_what_cannot_be_done_is_answered_with_the_reason(topic: str, payload: bytes, why: str) -> None:
    answer = asked(topic, payload)

    assert answer is not None
    assert why in answer[1]["error"]
    assert answer[1]["trips"] == 0


def test_a_retained_message_sets_no_knob() -> None:
    answer = asked("simulator/pump/trip", b"E05", is_retained=True)

    assert answer is not None
    assert "retained" in answer[1]["error"]
    assert answer[1]["trips"] == 0


async def test_only_a_broker_on_loopback_may_carry_them() -> None:
    with pytest.raises(UsageError, match="loopback"):
        async with simulator_topics({}, BrokerSettings("broker.plant", 1883, "simulator")):
            pytest.fail("connected")
