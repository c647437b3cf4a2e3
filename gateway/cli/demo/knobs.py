"""The knobs of simulated starters as topics of their own, `simulator/{starter}/{knob}`.

The gateway knows nothing of them. Only a broker on loopback may carry them.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress

from gateway.cli.broker import Subscription
from gateway.config import is_loopback
from gateway.errors import BrokerError, UsageError
from gateway.mqtt import BrokerSettings, Incoming, Message
from gateway.sim.controls import set_knob
from gateway.sim.core.unit import SimulatedUnit

log = logging.getLogger(__name__)

TREE = "simulator"
FILTER = f"{TREE}/+/+"
DONE = "done"  # simulator/{starter}/done says what a knob did
PAYLOAD_SHOWN = 40  # characters


@asynccontextmanager
async def simulator_topics(units: Mapping[str, SimulatedUnit], broker: BrokerSettings) -> AsyncIterator[None]:
    """Serve the knobs of these starters at a broker on loopback; UsageError for another broker."""
    if not is_loopback(broker.host):
        raise UsageError(
            f"broker {broker.host}: the knobs of simulated starters stay on loopback (mqtt://127.0.0.1)"
        )

    def take(incoming: Incoming) -> None:
        answer = answer_to(units, incoming)
        if answer is not None:
            subscription.publish(answer)

    subscription, lost = Subscription(broker, [FILTER], take), None
    with suppress(BrokerError):  # tried again
        lost = await subscription.connect()
    staying = asyncio.create_task(subscription.stay(lost))
    try:
        yield
    finally:
        staying.cancel()


def answer_to(units: Mapping[str, SimulatedUnit], incoming: Incoming) -> Message | None:
    """Apply the knob that a message names and return the answer; None for a message of our own."""
    _, starter, knob = incoming.topic.split("/")
    if knob == DONE:
        return None
    setting = incoming.payload.decode("utf-8", "replace")
    answer = {"knob": knob, "setting": setting[:PAYLOAD_SHOWN]}
    try:
        answer["text"] = _apply(units, starter, knob, setting, is_retained=incoming.is_retained)
        log.info("simulated starter=%s %s", starter, answer["text"])
    except UsageError as error:
        answer["error"] = str(error)
        log.warning("simulated starter=%s %s: %s", starter, knob, error)
    payload = json.dumps(answer).encode()
    return Message(f"{TREE}/{starter}/{DONE}", payload, qos=1, retain=False)


def _apply(
    units: Mapping[str, SimulatedUnit], starter: str, knob: str, setting: str, *, is_retained: bool
) -> str:
    unit = units.get(starter)
    if unit is None:
        raise UsageError(f"no simulated starter {starter[:PAYLOAD_SHOWN]!r} (one of {', '.join(units)})")
    if is_retained:
        raise UsageError("retained: it would be done again at every start")
    return set_knob(unit, knob, setting)
