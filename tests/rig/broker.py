"""A broker in memory, and paho's client without a socket: what Mosquitto does, as far as a client sees it.

`installed` has every client of paho that the process makes (the gateway's, Sparkplug's, a command's) speak to
the broker of its address. What a client sends arrives at once, what is sent to it in the loop's next round.
"""

from __future__ import annotations

import asyncio
import functools
import json
import os
import re
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any
from unittest.mock import patch

from paho.mqtt import client as paho
from paho.mqtt.enums import MQTTErrorCode
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from tests.rig import sparkplug

NOT_AUTHORIZED, TAKEN_OVER, WITH_WILL, LOST, KEEP_ALIVE = 0x87, 0x8E, 0x04, 0x80, 0x8D


@dataclass(frozen=True)
class MqttMessage:
    """A message as the broker got it."""

    at_s: float  # since the scenario's beginning
    topic: str
    payload: bytes
    qos: int = 0
    retain: bool = False
    client: str = ""
    expiry_s: int | None = None
    response_topic: str | None = None
    correlation: bytes | None = None

    @property
    def json(self) -> Any:
        """Return what it says: JSON, or the metrics of Sparkplug."""
        if self.topic.startswith("spBv1.0/") and "/STATE/" not in self.topic:
            return sparkplug.decoded(self.payload)
        return json.loads(self.payload)

    def __str__(self) -> str:
        flags = f"q{self.qos}{' R' if self.retain else ''}"
        return f"{self.at_s:.3f} {self.topic} {flags} {self.payload.decode('utf-8', 'backslashreplace')}"


def as_bytes(payload: Any) -> bytes:
    """Return bytes, a text, or what becomes JSON as a payload."""
    if isinstance(payload, bytes):
        return payload
    return (payload if isinstance(payload, str) else json.dumps(payload)).encode()


def matches(pattern: str, topic: str) -> bool:
    """Return whether a topic is one of a filter's [MQTT5 4.7]."""
    return _compiled(pattern).fullmatch(topic) is not None


@functools.lru_cache(maxsize=1000)
def _compiled(pattern: str) -> re.Pattern[str]:
    text = "/".join({"+": "[^/]*", "#": ".*"}.get(each) or re.escape(each) for each in pattern.split("/"))
    return re.compile(text.removesuffix("/.*") + "(?:/.*)?" if text.endswith("/.*") else text, re.DOTALL)


@dataclass
class Subscription:
    pattern: str
    qos: int = 1
    retain_as_published: bool = False


class RigWire:
    """What the loop watches in place of a socket."""

    _never: int | None = None  # a descriptor that can never be read

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._calls: dict[str, Callable[[], None] | None] = {"reader": None, "writer": None}
        self.inbox: deque[Callable[[], None]] = deque()  # packets to the client
        self.is_stalled = self.is_closed = False
        self.on_close: Callable[[], None] = lambda: None

    def fileno(self) -> int:
        if RigWire._never is None:
            RigWire._never = os.eventfd(0)
        return RigWire._never

    def setsockopt(self, *_: Any) -> None: ...

    def watch(self, end: str, call: Callable[[], None] | None) -> None:
        self._calls[end] = call
        if call is not None:
            self.poke(end, len(self.inbox) if end == "reader" else 1)

    def deliver(self, packet: Callable[[], None]) -> None:
        self.inbox.append(packet)
        self.poke("reader")

    def poke(self, end: str, times: int = 1) -> None:
        for _ in range(0 if self.is_stalled else times):
            self._loop.call_soon(self._call, end)

    def _call(self, end: str) -> None:
        call = self._calls[end]
        if call is not None and not self.is_stalled:
            call()

    def stall(self, *, is_stalled: bool) -> None:
        self.is_stalled = is_stalled
        self.poke("reader", len(self.inbox))
        self.poke("writer")

    def close(self) -> None:
        if not self.is_closed:
            self.is_closed = True
            self.inbox.clear()
            self.on_close()


class Connection:
    """A client at the broker: one of paho's, or one of the test's."""

    def __init__(self, broker: Broker, name: str, version: int = 5) -> None:
        self.broker = broker
        self.name = name
        self.version = version
        self.will: MqttMessage | None = None
        self.largest = 1 << 28
        self.subscriptions: dict[str, Subscription] = {}

    def receive(self, message: MqttMessage) -> None:
        """Take a message that the broker delivers."""
        raise NotImplementedError

    def lose(self, code: int) -> None:
        """Learn that the broker has ended the connection: with this code, or LOST without any word."""
        raise NotImplementedError

    def accept(self, subscription: Subscription, handling: int, suback: Callable[[int], object]) -> int:
        """Subscribe, give the SUBACK its code, then send what is retained; return the code."""
        broker = self.broker
        if broker.is_denied(self.name, subscription.pattern, "read"):
            code = NOT_AUTHORIZED if self.version == 5 else 0x80
            suback(code)
            return code
        is_new = subscription.pattern not in self.subscriptions
        self.subscriptions[subscription.pattern] = subscription
        suback(subscription.qos)
        if handling == 0 or (handling == 1 and is_new):
            for message in broker.retained_now():
                if matches(subscription.pattern, message.topic):
                    self.receive(message)
        return subscription.qos


class RigClient(Connection):
    """A client of the test's own: publishes, subscribes, remembers what it got."""

    def __init__(self, broker: Broker, name: str) -> None:
        super().__init__(broker, name)
        self.received: list[MqttMessage] = []
        broker.connections.append(self)

    def receive(self, message: MqttMessage) -> None:
        self.received.append(replace(message, at_s=self.broker.now_s()))

    def lose(self, code: int) -> None: ...

    def subscribe(self, pattern: str, *, handling: int = 0) -> int:
        return self.accept(Subscription(pattern, retain_as_published=True), handling, lambda _: None)

    def publish(self, topic: str, payload: Any = b"", **properties: Any) -> int:
        """Publish bytes, a text, or what becomes JSON; return the broker's reason code."""
        properties = {"qos": 1, "client": self.name, **properties}
        return self.broker.publish(MqttMessage(self.broker.now_s(), topic, as_bytes(payload), **properties))


@dataclass
class Broker:
    """What it retains, what it got, and what is wrong with it."""

    loop: asyncio.AbstractEventLoop
    now_s: Callable[[], float]
    log: list[MqttMessage] = field(default_factory=list)  # everything that any client published, wills too
    retained: dict[str, MqttMessage] = field(default_factory=dict)
    connections: list[Connection] = field(default_factory=list)
    denied: list[tuple[str, str, str]] = field(default_factory=list)  # client glob, topic filter, read|write
    connack: dict[str, int] = field(default_factory=dict)  # properties, such as ReceiveMaximum
    refuses: int | None = None  # every CONNECT, with this code
    speaks_5: bool = True
    ack_after_s: float | None = 0.0  # PUBACKs; None: they are lost
    is_up: bool = True
    is_stalled: bool = False
    wires: list[RigWire] = field(default_factory=list)
    logins: list[tuple[str, str | None, str | None]] = field(default_factory=list)  # client, user, password

    def client(self, name: str) -> RigClient:
        """Return a new client of the test's."""
        return RigClient(self, name)

    def deny(self, client: str, pattern: str, access: str) -> None:
        """Let clients (a glob) not `read` or `write` what a filter names."""
        self.denied.append((client, pattern, access))

    def stop(self) -> None:
        """End without a word, as by SIGKILL: connections are lost, new ones refused."""
        self.is_up = False
        self.drop()

    def start(self, *, retained: bool = True) -> None:
        """Begin again; without persistence nothing is retained any more."""
        self.is_up = True
        if not retained:
            self.retained.clear()

    def drop(self, name: str = "*", code: int = LOST) -> None:
        """End the connections of clients (a glob); their wills are published."""
        for each in tuple(self.connections):
            if fnmatchcase(each.name, name) and isinstance(each, PahoConnection):
                self.leave(each, with_will=self.is_up)
                each.lose(code)

    def stall(self, *, is_stalled: bool = True) -> None:
        """Stand still, with all connections open, or go on."""
        self.is_stalled = is_stalled
        self.wires = [wire for wire in self.wires if not wire.is_closed]
        for wire in self.wires:
            wire.stall(is_stalled=is_stalled)

    def is_denied(self, client: str, topic: str, access: str) -> bool:
        return any(
            fnmatchcase(client, who) and how == access and (pattern == topic or matches(pattern, topic))
            for who, pattern, how in self.denied
        )

    def retained_now(self) -> list[MqttMessage]:
        """Return what is retained and has not expired."""
        now_s = self.now_s()
        return [m for m in self.retained.values() if m.expiry_s is None or now_s < m.at_s + m.expiry_s]

    def publish(self, message: MqttMessage) -> int:
        """Take a message and pass it on; return the code of its PUBACK."""
        if self.is_denied(message.client, message.topic, "write"):
            return NOT_AUTHORIZED
        self.log.append(message)
        if message.retain and message.payload:
            self.retained[message.topic] = message
        elif message.retain:
            self.retained.pop(message.topic, None)
        for each in tuple(self.connections):
            found = [s for s in each.subscriptions.values() if matches(s.pattern, message.topic)]
            if found and not self.is_denied(each.name, message.topic, "read"):
                is_shown = message.retain and any(s.retain_as_published for s in found)
                qos = min(message.qos, max(s.qos for s in found))
                each.receive(replace(message, retain=is_shown, qos=qos))
        return 0

    def join(self, connection: PahoConnection) -> int:
        """Take a CONNECT and return the code of its CONNACK."""
        if self.refuses is not None:
            return self.refuses
        if connection.version == 5 and not self.speaks_5:
            return 0x84
        for each in tuple(self.connections):
            if each.name == connection.name and isinstance(each, PahoConnection):
                self.leave(each, with_will=True)
                each.lose(TAKEN_OVER)
        self.connections.append(connection)
        return 0

    def leave(self, connection: Connection, *, with_will: bool) -> None:
        """Forget a connection, with or without its will."""
        if connection in self.connections:
            self.connections.remove(connection)
            if with_will and connection.will is not None:
                self.publish(replace(connection.will, at_s=self.now_s()))


class PahoConnection(Connection):
    """One of paho's clients, between its calls and its callbacks."""

    def __init__(self, broker: Broker, client: Any, keepalive_s: int, properties: Properties | None) -> None:
        super().__init__(broker, client._client_id.decode(), 5 if client._protocol == 5 else 4)
        self.client = client
        self.is_clean = False  # begun without a session, and none stays after it
        self.wire = RigWire(broker.loop)
        self.wire.is_stalled = broker.is_stalled
        self.wire.on_close = self._closed
        broker.wires.append(self.wire)
        self.outbox: deque[Callable[[], None]] = deque()
        self.largest = getattr(properties, "MaximumPacketSize", self.largest)
        self._keepalive_s = keepalive_s
        self._received_s = self._said_s = time.monotonic()
        self._pinged_s: float | None = None
        if client._will:
            topic, payload = client._will_topic.decode(), client._will_payload
            self.will = MqttMessage(0.0, topic, payload, client._will_qos, client._will_retain, self.name)
        user, password = (None if x is None else x.decode() for x in (client._username, client._password))
        broker.logins.append((self.name, user, password))

    # To the broker

    def send(self, packet: Callable[[], None]) -> None:
        self.outbox.append(packet)
        if self.client.on_socket_register_write is not None:
            self.client.on_socket_register_write(self.client, None, self.wire)

    def flush(self) -> None:
        while self.outbox and not self.wire.is_stalled and not self.wire.is_closed:
            self._said_s = time.monotonic()
            self.outbox.popleft()()
        if not self.outbox and self.client.on_socket_unregister_write is not None:
            self.client.on_socket_unregister_write(self.client, None, self.wire)

    def connect(self) -> None:
        code = self.broker.join(self)
        properties = Properties(PacketTypes.CONNACK)
        for name, value in self.broker.connack.items():
            setattr(properties, name, value)
        said = ReasonCode(PacketTypes.CONNACK, identifier=code)
        flags = paho.ConnectFlags(session_present=False)
        self._deliver(lambda: self.client.on_connect(self.client, None, flags, said, properties))
        if code:
            self._deliver(lambda: self._end(LOST))

    def publish(self, mid: int, message: MqttMessage) -> None:
        code = self.broker.publish(replace(message, at_s=self.broker.now_s()))
        if message.qos:
            reason = bytes([code]) if code and self.version == 5 else b""
            self._acknowledge(lambda: self._puback(mid.to_bytes(2) + reason))

    def _puback(self, body: bytes) -> None:
        self.client._in_packet |= {"command": 0x40, "packet": bytearray(body)}
        self.client._handle_pubackcomp("PUBACK")

    def subscribe(self, mid: int, subscription: Subscription, handling: int) -> None:
        def suback(code: int) -> None:
            said = ReasonCode(PacketTypes.SUBACK, identifier=code)
            self._deliver(lambda: self.client.on_subscribe(self.client, None, mid, [said], None))

        self.accept(subscription, handling, suback)

    def disconnect(self, with_will: bool) -> None:
        self.broker.leave(self, with_will=with_will)
        self._end(0)

    def _acknowledge(self, puback: Callable[[], None]) -> None:
        after_s = self.broker.ack_after_s
        if after_s == 0.0:
            self._deliver(puback)
        elif after_s is not None:
            self.broker.loop.call_later(after_s, self._deliver, puback)

    # To the client

    def receive(self, message: MqttMessage) -> None:
        if len(message.payload) + len(message.topic) + 16 > self.largest:
            return
        taken = paho.MQTTMessage(topic=message.topic.encode())
        taken.payload, taken.qos, taken.retain = message.payload, message.qos, message.retain
        if self.version == 5:
            taken.properties = Properties(PacketTypes.PUBLISH)
            for name, value in (
                ("MessageExpiryInterval", message.expiry_s),
                ("ResponseTopic", message.response_topic),
                ("CorrelationData", message.correlation),
            ):
                if value is not None:
                    setattr(taken.properties, name, value)
        self._deliver(lambda: self.client.on_message(self.client, None, taken))

    def lose(self, code: int) -> None:
        self._deliver(lambda: self._end(code))

    def read(self) -> None:
        if self.wire.inbox:
            self._received_s = time.monotonic()
            self.wire.inbox.popleft()()

    def look(self) -> None:
        """Send a ping when it is time for one; one that is not answered ends the connection."""
        now_s = time.monotonic()
        if now_s - min(self._received_s, self._said_s) < self._keepalive_s:
            return
        if self._pinged_s is None or self._received_s >= self._pinged_s:
            self._pinged_s = self._said_s = now_s
            self.send(lambda: self._deliver(lambda: None))
        elif now_s - self._pinged_s >= self._keepalive_s:
            self.broker.leave(self, with_will=True)
            self._end(KEEP_ALIVE)

    def _deliver(self, packet: Callable[[], None]) -> None:
        if not self.wire.is_closed:
            self.wire.deliver(packet)

    def _end(self, code: int) -> None:
        """Have paho report the end of the connection."""
        client, self.client._rig = self.client, None
        self.wire.on_close = lambda: None
        self.wire.close()
        if client.on_socket_close is not None:
            client.on_socket_close(client, None, self.wire)
        if client.on_disconnect is not None:
            flags = paho.DisconnectFlags(is_disconnect_packet_from_server=code not in (0, LOST, KEEP_ALIVE))
            said = ReasonCode(PacketTypes.DISCONNECT, identifier=code)
            client.on_disconnect(client, None, flags, said, None)

    def _closed(self) -> None:
        """Learn that the client has closed its socket without DISCONNECT."""
        self.broker.leave(self, with_will=True)


class _Paho:
    """What replaces paho's methods that touch a socket."""

    _rig: PahoConnection | None = None
    broker_at: Callable[[str, int], Broker]

    def connect(
        self: Any,
        host: str,
        port: int = 1883,
        keepalive: int = 60,
        *_: Any,
        clean_start: bool = False,
        properties: Any = None,
        **__: Any,
    ) -> MQTTErrorCode:
        broker = self.broker_at(host, port)
        if not broker.is_up:
            raise ConnectionRefusedError(111, "Connection refused")
        connection = self._rig = PahoConnection(broker, self, keepalive, properties)
        connection.is_clean = self._clean_session if connection.version == 4 else clean_start
        connection.is_clean &= getattr(properties, "SessionExpiryInterval", 0) == 0
        if self.on_socket_open is not None:
            self.on_socket_open(self, None, connection.wire)
        connection.send(connection.connect)
        return MQTTErrorCode.MQTT_ERR_SUCCESS

    def socket(self: Any) -> RigWire | None:
        return None if self._rig is None else self._rig.wire

    def want_write(self: Any) -> bool:
        return self._rig is not None and bool(self._rig.outbox)

    def loop_read(self: Any, *_: Any) -> None:
        if self._rig is not None:
            self._rig.read()

    def loop_write(self: Any, *_: Any) -> None:
        if self._rig is not None:
            self._rig.flush()

    def loop_misc(self: Any) -> None:
        if self._rig is not None:
            self._rig.look()

    def _send_publish(
        self: Any, mid: int, topic: bytes, payload: bytes, qos: int, retain: bool,
        dup: bool = False, info: Any = None, properties: Any = None,
    ) -> None:  # fmt: skip
        if (connection := self._rig) is not None:
            optional = ("MessageExpiryInterval", "ResponseTopic", "CorrelationData")
            more = (getattr(properties, name, None) for name in optional)
            message = MqttMessage(0.0, topic.decode(), payload, qos, retain, connection.name, *more)
            connection.send(lambda: connection.publish(mid, message))

    def subscribe(self: Any, topic: str, qos: int = 0, options: Any = None) -> tuple[Any, int | None]:
        if self._rig is None:
            return MQTTErrorCode.MQTT_ERR_NO_CONN, None
        mid, connection, handling = self._mid_generate(), self._rig, 0
        subscription = Subscription(topic, qos)
        if options is not None:
            subscription = Subscription(topic, options.QoS, options.retainAsPublished)
            handling = options.retainHandling
        connection.send(lambda: connection.subscribe(mid, subscription, handling))
        return MQTTErrorCode.MQTT_ERR_SUCCESS, mid

    def unsubscribe(self: Any, topic: str) -> None:
        if self._rig is not None:
            connection = self._rig
            connection.send(lambda: connection.subscriptions.pop(topic, None))

    def disconnect(self: Any, reasoncode: Any = None, properties: Any = None) -> None:
        if self._rig is not None:
            connection, with_will = self._rig, reasoncode is not None and reasoncode.value == WITH_WILL
            connection.send(lambda: connection.disconnect(with_will))


@contextmanager
def installed(broker_at: Callable[[str, int], Broker]) -> Iterator[None]:
    """Have every client of paho speak to the broker of its address."""
    names: Iterable[str] = [name for name in vars(_Paho) if not name.startswith("__") and name != "broker_at"]
    with ExitStack() as stack:
        for name in names:
            stack.enter_context(patch.object(paho.Client, name, vars(_Paho)[name], create=True))
        stack.enter_context(patch.object(paho.Client, "broker_at", staticmethod(broker_at), create=True))
        yield
