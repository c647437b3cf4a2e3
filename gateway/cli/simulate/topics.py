"""The knobs of simulated starters as topics apart from any gateway's: `simulator/{starter}/{knob}`.

The gateway knows nothing of them. Only a broker on loopback may carry them.
"""

from __future__ import annotations

import asyncio
import json
import logging
import time
import uuid
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager, suppress

from gateway.config.values import is_loopback
from gateway.errors import UsageError
from gateway.mqtt.connection.broker import BrokerConnection
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.mqtt.contract.commands import Incoming
from gateway.mqtt.contract.payloads import Message
from gateway.mqtt.outbox.outbox import Outbox
from gateway.sim.controls import set_knob
from gateway.sim.core.unit import SimulatedUnit

log = logging.getLogger(__name__)

TREE = "simulator"
FILTER = f"{TREE}/+/+"
DONE = "done"  # simulator/{starter}/done says what a knob did
MOST_WAITING = 100  # answers, while the broker is away

_PAYLOAD_SHOWN = 40


@asynccontextmanager
async def simulator_topics(
    units: Mapping[str, SimulatedUnit], *, host: str, port: int
) -> AsyncIterator[None]:
    """Serve the knobs of these starters at a broker on loopback; UsageError for another broker."""
    if not is_loopback(host):
        raise UsageError(
            f"broker {host}: the knobs of simulated starters stay on loopback (mqtt://127.0.0.1)"
        )
    answers = Outbox(last_topic="", pack=_not_packed, max_rows=MOST_WAITING)
    settings = BrokerSettings(host=host, port=port, client_id=f"simulator-{uuid.uuid4().hex[:8]}")

    def take(incoming: Incoming) -> None:
        answer = answer_to(units, incoming)
        if answer is not None:
            answers.put(answer, time.monotonic())
            connection.wake()

    connection = BrokerConnection(
        settings, answers, command_filter=FILTER, will=lambda: None, on_incoming=take, on_link=_log_link
    )
    running = asyncio.create_task(connection.run())
    try:
        yield
    finally:
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running


def answer_to(units: Mapping[str, SimulatedUnit], incoming: Incoming) -> Message | None:
    """Apply the knob that a message names and return the answer; None for a message of our own."""
    _, starter, knob = incoming.topic.split("/")
    if knob == DONE:
        return None
    setting = incoming.payload.decode("utf-8", "replace")
    answer = {"knob": knob, "setting": setting[:_PAYLOAD_SHOWN]}
    try:
        answer["text"] = _apply(units, starter, knob, setting, is_retained=incoming.is_retained)
        log.info("simulated starter=%s %s", starter, answer["text"])
    except UsageError as error:
        answer["error"] = str(error)
        log.warning("simulated starter=%s %s: %s", starter, knob, error)
    payload = json.dumps(answer).encode()
    return Message(f"{TREE}/{starter}/{DONE}", payload, qos=1, retain=False, is_queued=True)


def _apply(
    units: Mapping[str, SimulatedUnit], starter: str, knob: str, setting: str, *, is_retained: bool
) -> str:
    unit = units.get(starter)
    if unit is None:
        raise UsageError(f"no simulated starter {starter[:_PAYLOAD_SHOWN]!r} (one of {', '.join(units)})")
    if is_retained:
        raise UsageError("retained: it would be done again at every start")
    return set_knob(unit, knob, setting)


def _not_packed(topic: str, _items: Sequence[str], _boot: str) -> Message:
    """Take what no answer has: replaced values."""
    raise AssertionError(topic)


def _log_link(is_connected: bool, trouble: str) -> None:  # noqa: FBT001 - the connection's signature
    log.debug("knobs: connected=%s %s", is_connected, trouble)
