"""The broker in memory of the rig answers as a real Mosquitto does: the same exchanges at both."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from contextlib import ExitStack
from typing import Any

import pytest
from paho.mqtt import client as paho
from paho.mqtt.client import CallbackAPIVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from tests.mosquitto import StartMosquitto
from tests.rig.broker import Broker, installed

ACL = """
user plant
topic readwrite open/#
topic read closed/#
user other
topic readwrite open/#
topic write closed/#
"""
USERS = {"plant": "right", "other": "right"}
NO_READER = 0x10  # a PUBACK's success, where no client has subscribed: nothing that a publisher should need
V5, V3 = paho.MQTTv5, paho.MQTTv311


class Peer:
    """One of paho's clients, driven by this loop; `said` is all that it learns from the broker."""

    def __init__(
        self, port: int, name: str, version: int = V5, *, password: str = "right", will: str = ""
    ) -> None:
        self.said: list[Any] = []
        self._is_broken = False
        self._loop = asyncio.get_running_loop()
        client = self._client = paho.Client(CallbackAPIVersion.VERSION2, name, protocol=version)  # type: ignore[arg-type]
        client.username_pw_set(name.split("-")[0], password)
        if will:
            client.will_set(will, b"gone", qos=1)
        client.on_socket_open = lambda *call: self._watch(call[2], "reader", client.loop_read)
        client.on_socket_close = lambda *call: self._watch(call[2], "reader", None)
        client.on_socket_register_write = lambda *call: self._watch(call[2], "writer", client.loop_write)
        client.on_socket_unregister_write = lambda *call: self._watch(call[2], "writer", None)
        client.on_connect = lambda *call: self.said.append(("connected", call[3].value))
        client.on_disconnect = lambda *_: self.said.append(("ended",))
        client.on_subscribe = lambda *call: self.said.append(("subscribed", [each.value for each in call[3]]))
        client.on_publish = lambda *call: self.said.append(
            ("acknowledged", {NO_READER: 0}.get(call[3].value, call[3].value))
        )
        client.on_message = lambda *call: self.said.append(self._said(call[2]))
        self._version = version
        client.connect("127.0.0.1", port, keepalive=20, **({"clean_start": True} if version == V5 else {}))

    async def rest(self, seconds: float = 0.15) -> Peer:
        await asyncio.sleep(seconds)
        self._client.loop_misc()
        return self

    async def subscribe(self, topic: str, qos: int = 1, **options: Any) -> None:
        if self._version == V5:
            self._client.subscribe(topic, options=SubscribeOptions(qos=qos, **options))
        else:
            self._client.subscribe(topic, qos)
        await self.rest()

    async def publish(
        self, topic: str, payload: bytes, *, retain: bool = False, rest_s: float = 0.15, **more: Any
    ) -> None:
        properties = Properties(PacketTypes.PUBLISH) if self._version == V5 else None
        for name, value in more.items():
            setattr(properties, name, value)
        self._client.publish(topic, payload, 1, retain, properties)
        await self.rest(rest_s)

    async def leave(self, code: int | None = None) -> None:
        if self._is_broken:
            return
        self._client.disconnect(None if code is None else ReasonCode(PacketTypes.DISCONNECT, identifier=code))
        await self.rest()

    async def break_off(self) -> None:
        """End without a DISCONNECT, as when a process is killed."""
        self._is_broken = True
        wire: Any = self._client.socket()
        self._watch(wire, "reader", None)
        wire.close()
        await self.rest()

    def _said(self, message: paho.MQTTMessage) -> tuple[Any, ...]:
        more = getattr(message, "properties", None)
        response, correlation = (getattr(more, name, None) for name in ("ResponseTopic", "CorrelationData"))
        return ("message", message.topic, message.payload, message.qos, message.retain, response, correlation)

    def _watch(self, wire: Any, end: str, call: Callable[[], Any] | None) -> None:
        if hasattr(wire, "watch"):
            wire.watch(end, call)
        elif call is not None:
            getattr(self._loop, f"add_{end}")(wire, call)
        elif wire.fileno() >= 0:  # else it was broken off
            getattr(self._loop, f"remove_{end}")(wire)


Join = Callable[..., Awaitable[Peer]]


async def delivery(join: Join) -> list[Any]:
    """Messages come in order, on matching topics alone, at the lower of both QoS."""
    reader, writer = await join("plant"), await join("other")
    await reader.subscribe("open/+/b", qos=1)
    await reader.subscribe("open/zero/#", qos=0)
    for topic in ("open/a/b", "open/a/c", "open/a/b/c", "open/zero", "open/zero/x/y"):
        await writer.publish(topic, topic.encode())
    for number in range(20):
        await writer.publish("open/a/b", b"%d" % number, rest_s=0.0)
    await writer.rest()
    return [reader.said, writer.said]


async def retained(join: Join) -> list[Any]:
    """What is retained comes with its flag to who subscribes later; an empty payload deletes it."""
    writer = await join("other")
    for topic, payload in (("open/a", b"1"), ("open/a", b"2"), ("open/b", b"1"), ("open/b", b"")):
        await writer.publish(topic, payload, retain=True)
    reader = await join("plant")
    await reader.subscribe("open/#")
    return [reader.said]


async def live_flag(join: Join) -> list[Any]:
    """The flag of a live message shows where retain as published was asked for."""
    plain, shown, writer = await join("plant"), await join("plant-2"), await join("other")
    await plain.subscribe("open/#")
    await shown.subscribe("open/#", retainAsPublished=True)
    await writer.publish("open/a", b"live", retain=True)
    return [plain.said, shown.said]


async def handling(join: Join) -> list[Any]:
    """Retain handling 0 sends what is retained each time, 1 with a new subscription, 2 never."""
    writer = await join("other")
    await writer.publish("open/a", b"stored", retain=True)
    readers = [await join(f"plant-{number}") for number in range(3)]
    for _ in range(2):
        for number, reader in enumerate(readers):
            await reader.subscribe("open/a", retainHandling=number)
    return [reader.said for reader in readers]


async def wills(join: Join) -> list[Any]:
    """A will is published when a connection breaks off or asks for it, not when it ends in order."""
    reader = await join("plant")
    await reader.subscribe("open/#")
    for number, code in enumerate((None, 0x04, -1)):
        peer = await join(f"other-{number}", will=f"open/will/{number}")
        await (peer.break_off() if code == -1 else peer.leave(code))
    return [reader.said]


async def take_over(join: Join) -> list[Any]:
    """A second client with the same id ends the first one's connection, whose will is published."""
    reader = await join("plant")
    await reader.subscribe("open/#")
    first = await join("other", will="open/will")
    second = await join("other")
    return [reader.said, first.said, second.said]


async def denied(join: Join) -> list[Any]:
    """What may not be written is refused in its acknowledgement; what may not be read does not come."""
    reader, writer = await join("plant"), await join("other")
    await reader.subscribe("closed/#")
    await reader.publish("closed/a", b"1")
    await writer.publish("closed/a", b"2")
    return [reader.said, writer.said]


async def old_version(join: Join) -> list[Any]:
    """MQTT 3.1.1: no reasons and no flags of live messages; what is denied is acknowledged all the same."""
    reader, writer = await join("plant", V3), await join("other", V3)
    await reader.subscribe("open/#")
    await reader.publish("closed/a", b"1")
    await writer.publish("open/a", b"live", retain=True)
    late = await join("plant-late", V3)
    await late.subscribe("open/#")
    return [reader.said, writer.said, late.said]


async def properties(join: Join) -> list[Any]:
    """Response topic and correlation data arrive; what has expired does not."""
    writer, reader = await join("other"), await join("plant")
    await writer.publish("open/a", b"brief", retain=True, MessageExpiryInterval=1)
    await writer.publish("open/b", b"long", retain=True, MessageExpiryInterval=60)
    await reader.subscribe("open/c")
    await writer.publish("open/c", b"ask", ResponseTopic="open/answer", CorrelationData=b"7")
    await reader.rest(2.2)
    await reader.subscribe("open/#", retainHandling=0)
    return [reader.said]


async def wrong_login(join: Join) -> list[Any]:
    """A wrong password is refused with a reason, and the connection ends."""
    return [[each for each in (await join("plant", password="wrong")).said if each[0] == "connected"]]


EXCHANGES = [
    delivery,
    retained,
    live_flag,
    handling,
    wills,
    take_over,
    denied,
    old_version,
    properties,
    wrong_login,
]


async def at(port: int, exchange: Callable[[Join], Awaitable[list[Any]]]) -> list[Any]:
    peers: list[Peer] = []

    async def join(name: str, version: int = V5, **options: Any) -> Peer:
        peers.append(Peer(port, name, version, **options))
        return await peers[-1].rest()

    said = [list(each) for each in await exchange(join)]
    for peer in peers:
        await peer.leave()
    return said


async def in_memory(exchange: Callable[[Join], Awaitable[list[Any]]]) -> list[Any]:
    broker = Broker(asyncio.get_running_loop(), time.monotonic)
    broker.deny("plant*", "closed/#", "write")
    broker.deny("other*", "closed/#", "read")
    broker.refuses = 0x87 if exchange is wrong_login else None
    with ExitStack() as stack:
        stack.enter_context(installed(lambda *_: broker))
        return await at(1883, exchange)


@pytest.mark.parametrize("exchange", EXCHANGES, ids=lambda each: each.__name__)
async def test_the_broker_in_memory_does_what_mosquitto_does(
    exchange: Callable[[Join], Awaitable[list[Any]]], start_mosquitto: StartMosquitto
) -> None:
    mosquitto = start_mosquitto(users=USERS, acl=ACL)

    real = await at(mosquitto.port, exchange)
    rig = await in_memory(exchange)

    assert rig == real
    assert any(real)
