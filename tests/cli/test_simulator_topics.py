"""The simulator's own topics: what is answered, and what is refused."""

from __future__ import annotations

import pytest

from gateway.cli.demo.knobs import answer_to, simulator_topics
from gateway.errors import UsageError
from gateway.mqtt.commands import Incoming
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.sim.factory import make_unit


@pytest.mark.parametrize(
    ("topic", "payload", "said"),
    [
        ("pump/trip", b"E05", "tripped: E05"),
        ("pump/trip", b"\xff\xfe", "no number"),
        ("pump/explode", b"", "no knob 'explode'"),
        ("fan/trip", b"", "no simulated starter 'fan' (one of pump)"),
        ("pump/done", b"{}", ""),  # an answer of its own
    ],
)
@pytest.mark.parametrize("is_retained", [False, True])
def test_a_knob_is_turned_and_the_answer_says_what_was_done_or_why_not(
    topic: str, payload: bytes, said: str, *, is_retained: bool
) -> None:
    unit = make_unit("ssw07", 1)

    asked = Incoming(f"simulator/{topic}", payload, is_retained=is_retained)
    answer = answer_to({"pump": unit}, asked)

    assert (answer is None) is (not said)
    if answer is not None:
        assert answer.topic == f"simulator/{topic.split('/')[0]}/done"
        assert ("retained" if is_retained and topic.startswith("pump") else said) in answer.payload.decode()
    assert len(unit.trips) == (said.startswith("tripped") and not is_retained)


async def test_only_a_broker_on_loopback_may_carry_them() -> None:
    with pytest.raises(UsageError, match="loopback"):
        async with simulator_topics({}, BrokerSettings("broker.plant", 1883, "simulator")):
            pytest.fail("connected")
