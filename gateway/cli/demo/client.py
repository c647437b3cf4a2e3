"""What the demo's guide needs of MQTT where Mosquitto's own clients are not installed: watch and publish."""

from __future__ import annotations

import asyncio
import uuid

from gateway.errors import BrokerError
from gateway.mqtt.connection.command_client import connected
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.mqtt.contract.commands import Incoming
from gateway.mqtt.contract.payloads import Message

ACKNOWLEDGED_WITHIN_S = 5.0
REFUSED = 0x80  # reason codes from here on [MQTT5 2.4]


async def watch(port: int, topic: str) -> None:
    """Print topic and payload of each message that comes, until the connection is lost or Ctrl-C."""
    session, _ = await connected(_settings(port), on_incoming=_show)
    try:
        if not await session.subscribe(topic, with_retained=True):
            raise BrokerError(f"the broker on port {port} does not let {topic} be read")
        await session.lost
    finally:
        await session.disconnect()
    raise BrokerError(f"the connection to the broker on port {port} was lost", "does the demo still run?")


async def publish(port: int, topic: str, payload: str) -> None:
    """Publish one message, not retained; BrokerError unless the broker has taken it."""
    acknowledged: asyncio.Queue[int] = asyncio.Queue()
    session, _ = await connected(_settings(port), on_ack=lambda _, code: acknowledged.put_nowait(code))
    try:
        session.publish(1, Message(topic, payload.encode(), qos=1, retain=False))
        code = await asyncio.wait_for(acknowledged.get(), ACKNOWLEDGED_WITHIN_S)
    except TimeoutError:
        raise BrokerError(f"the broker on port {port} has not taken the message") from None
    finally:
        await session.disconnect()
    if code >= REFUSED:
        raise BrokerError(f"the broker on port {port} does not let {topic} be written")


def _settings(port: int) -> BrokerSettings:
    return BrokerSettings("127.0.0.1", port, f"starter-gateway-demo-{uuid.uuid4().hex[:8]}")


def _show(message: Incoming) -> None:
    print(message.topic, message.payload.decode("utf-8", "replace"), flush=True)
