"""One connection to the broker, from CONNECT to its loss: what is asked of paho, and what it reports.

A client that connects a second time replays its queue without regard to any window, so each session has its
own. The running loop serves its socket; only `connect` blocks, in a thread, and the loop waits for its end.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from paho.mqtt import client as paho
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from gateway.contract import Event, EventCode, event_of
from gateway.errors import BrokerError
from gateway.mqtt.commands import Incoming
from gateway.mqtt.connection.client import MAX_INCOMING_BYTES, SessionClient, TooLargeError, too_large
from gateway.mqtt.connection.reasons import (
    PACKET_TOO_LARGE,
    SESSION_TAKEN_OVER,
    refused,
    unreachable,
)
from gateway.mqtt.connection.settings import BrokerSettings, Version
from gateway.mqtt.message import FIRST_FAILURE, Message

CONNECTION_LOST = "connection lost"
CALLBACKS = [f"on_{each}" for each in ("connect", "disconnect", "subscribe", "message")]
CALLBACKS += [f"on_socket_{each}" for each in ("open", "close", "register_write", "unregister_write")]
WITH_WILL = 0x04  # DISCONNECT [MQTT5 3.14.2.1]
READ_FOR_S = 0.003  # before other tasks of the loop run
ANSWER_S = 10.0  # how long the broker may take for CONNACK and SUBACK
PONG_S = 15.0  # how long for PINGRESP; at least the keep-alive
ACK_S = 30.0  # how long for a PUBACK
WINDOW = 20  # unacknowledged messages at most; the broker may ask for less


def _ignore(*_: object) -> None:
    """Do nothing."""


@dataclass(frozen=True, slots=True)
class SessionParts:
    """What a session needs of its owner; all calls on its loop."""

    will: Message | None = None  # what the broker publishes when the connection is lost; None: nothing
    on_incoming: Callable[[Incoming], None] = _ignore
    on_ack: Callable[[int, int], None] = _ignore  # a message's end: its ticket, the broker's reason code
    on_skip: Callable[[Event], None] = _ignore  # a packet was too large, and all but its topic is lost


class Session:
    """One connection; `lost` is done, with the reason, as soon as it is over."""

    def __init__(self, settings: BrokerSettings, version: Version, parts: SessionParts) -> None:
        self._loop = asyncio.get_running_loop()
        self._settings = settings
        self.version = version
        self._parts = parts
        self._connack: asyncio.Future[None] = self._loop.create_future()
        self._subacks: dict[int, Callable[[bool], None]] = {}  # by packet id, which take the answer
        self._tickets: dict[int, tuple[int, float]] = {}  # by packet id: ticket, time sent
        self._sock: Any = None  # paho's socket, while the loop serves it
        self._misc: asyncio.TimerHandle | None = None  # None: the broker's port never took the connection
        self._max_packet: int | None = None
        self.lost: asyncio.Future[str] = self._loop.create_future()
        self.notice: Event | None = None  # about the loss, when that needs an event of its own
        self.connack_code: int | None = None  # None: the broker never answered
        self.window = WINDOW
        self._client = self._make_client()

    async def connect(self) -> None:
        """Connect; BrokerError when the broker is away or refuses. If cancelled, it cleans up."""
        pool = ThreadPoolExecutor(1, thread_name_prefix="mqtt-connect")
        connecting = pool.submit(self._connect_blocking)
        pool.shutdown(wait=False)
        try:
            await asyncio.wrap_future(connecting)
            self._serve()
            await self._answer(self._connack, "CONNACK")
        except asyncio.CancelledError:
            self.abort()
            connecting.add_done_callback(lambda _: self._close_socket())
            raise
        except (OSError, ValueError) as error:
            raise unreachable(self._settings.address, error) from error
        finally:
            del connecting  # it holds what was raised, whose traceback holds this frame

    async def subscribe(self, topic_filter: str, *, with_retained: bool = False) -> bool:
        """Subscribe and return whether the broker lets us; MQTT 3.1.1 sends retained messages anyway."""
        suback: asyncio.Future[bool] = self._loop.create_future()
        handling = 0 if with_retained else 2  # 2: no stored ones; live ones show their retained flag too
        options = SubscribeOptions(qos=1, retainAsPublished=True, retainHandling=handling)
        self._ask(topic_filter, options, suback.set_result)
        return bool(await self._answer(suback, "SUBACK"))

    def read(self, topic_filter: str, on_answer: Callable[[bool], None]) -> None:
        """Subscribe without waiting for the answer; a refusal changes nothing else.

        No queue of the broker limits QoS 0. Only what is stored is marked as retained.
        """
        options = SubscribeOptions(qos=0, retainAsPublished=False, retainHandling=0)
        self._ask(topic_filter, options, on_answer)

    def unlisten(self, topic: str) -> None:
        """End a subscription."""
        if not self.lost.done():
            self._client.unsubscribe(topic)

    @property
    def is_closed_unanswered(self) -> bool:
        """Return whether the broker ended the connection before it had answered CONNECT."""
        return self._misc is not None and self.connack_code is None and self.lost.done()

    @property
    def in_flight(self) -> int:
        """Return how many messages the broker has not acknowledged yet."""
        return len(self._tickets)

    @property
    def has_sent_all(self) -> bool:
        """Return whether the socket has taken everything that was published so far."""
        return not self._client.want_write()

    def publish_now(self, message: Message) -> bool:
        """Send a message of QoS 0 at once; return False when the socket has not taken what was before it."""
        if self._client.want_write():
            self._write()  # what was asked for just now, e.g. subscriptions
        if self.lost.done() or self._client.want_write():
            return False
        self._client.send(message)
        return True

    def publish(self, ticket: int, message: Message) -> int | None:
        """Send a message; return a reason code when it cannot be sent, else `on_ack` reports its end."""
        if self.lost.done():
            return None  # the outbox still has it
        if self._max_packet is not None and message.packet_size > self._max_packet:
            return PACKET_TOO_LARGE
        properties = None
        if self.version is Version.V5 and message.correlation is not None:
            properties = _properties(PacketTypes.PUBLISH)
            properties.CorrelationData = message.correlation
        packet_id = self._client.send(message, properties)
        if message.qos:
            self._tickets[packet_id] = (ticket, self._loop.time())
        return None

    async def disconnect(self, *, with_will: bool = False) -> None:
        """Say goodbye; the broker publishes the will only when asked to, which MQTT 5 alone can do."""
        if with_will and self.version is Version.V5:
            self._client.disconnect(reasoncode=ReasonCode(PacketTypes.DISCONNECT, identifier=WITH_WILL))
        else:
            self._client.disconnect()
        await asyncio.wait([self.lost], timeout=1.0)
        self.abort()

    def abort(self) -> None:
        """Drop the connection at once; the broker then publishes the will. May be called again."""
        self._release()
        self._close_socket()
        self._lose("closed by the gateway")
        self._connack.cancel()
        self._subacks.clear()
        self._client.on_skip = self._client.on_ack = _ignore
        for name in CALLBACKS:  # or the two hold each other until the next whole garbage collection
            setattr(self._client, name, None)

    def _make_client(self) -> SessionClient:
        is_v5 = self.version is Version.V5
        client = SessionClient(
            CallbackAPIVersion.VERSION2,
            client_id=self._settings.client_id,
            clean_session=None if is_v5 else True,
            protocol=MQTTProtocolVersion.MQTTv5 if is_v5 else MQTTProtocolVersion.MQTTv311,
            reconnect_on_failure=False,
        )
        client.on_skip = self._on_skip
        client.on_ack = self._on_ack
        for name in CALLBACKS:
            setattr(client, name, getattr(self, f"_{name}"))
        return client

    def _connect_blocking(self) -> None:
        settings = self._settings
        if settings.tls is not None:
            self._client.tls_set_context(settings.tls.context())
        self._client.username_pw_set(settings.username, settings.password)
        will = self._parts.will
        if will is not None:
            self._client.will_set(will.topic, will.payload, qos=will.qos, retain=will.retain)
        if self.version is Version.V311:
            self._client.connect(settings.host, settings.port, settings.keepalive_s)
            return
        properties = _properties(PacketTypes.CONNECT)
        properties.SessionExpiryInterval = 0  # the broker must not collect commands for an absent gateway
        properties.MaximumPacketSize = settings.largest_packet or MAX_INCOMING_BYTES
        self._client.connect(
            settings.host, settings.port, settings.keepalive_s, clean_start=True, properties=properties
        )

    def _close_socket(self) -> None:
        if (sock := self._client.socket()) is not None:
            sock.close()

    def _ask(self, topic_filter: str, options: SubscribeOptions, on_answer: Callable[[bool], None]) -> None:
        """Subscribe; `on_answer` is called with whether the broker lets us, unless the connection is lost.

        MQTT 3.1.1 knows the quality of service alone.
        """
        if self.lost.done():
            return
        how: dict[str, Any] = {"options": options} if self.version is Version.V5 else {"qos": options.QoS}
        _, packet_id = self._client.subscribe(topic_filter, **how)
        if packet_id is not None:  # None: the connection is lost
            self._subacks[packet_id] = on_answer

    async def _answer(self, answer: asyncio.Future[Any], name: str) -> Any:
        await asyncio.wait([answer, self.lost], timeout=ANSWER_S, return_when=asyncio.FIRST_COMPLETED)
        if answer.done():
            return answer.result()
        why = f": {self.lost.result()}" if self.lost.done() else f" within {ANSWER_S:g} s"
        raise BrokerError(f"broker {self._settings.address} sent no {name}{why}")

    # The loop's service of the socket.

    def _serve(self) -> None:
        self._sock = self._client.socket()
        self._loop.add_reader(self._sock, self._read)
        self._loop.add_writer(self._sock, self._client.loop_write)  # CONNECT is waiting already
        self._tick()

    def _release(self) -> None:
        if self._misc is not None:
            self._misc.cancel()
        if self._sock is not None:
            self._loop.remove_reader(self._sock)
            self._loop.remove_writer(self._sock)
            self._sock = None

    def _read(self) -> None:
        until_s = self._loop.time() + READ_FOR_S
        while self._sock is not None:
            try:
                self._client.loop_read()
            except TooLargeError as error:
                self._lose_with(too_large(error.size, is_skipped=False))
                return
            except Exception as error:  # noqa: BLE001 - this callback's one guard: nonsense ends the session
                self._lose(f"the broker sent what cannot be read: {error!r}")
                return
            if self._sock is None or not self._client.has_more:
                break
            if self._loop.time() >= until_s:
                # Not besides a call for the socket: each would ask for one more, until they fill the loop.
                self._loop.remove_reader(self._sock)
                self._loop.call_soon(self._read_on)
                break
        # Else a broker that saves packets (Nagle) keeps the next message back.
        if self._sock is not None:
            self._sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)

    def _read_on(self) -> None:
        if self._sock is not None:
            self._loop.add_reader(self._sock, self._read)
            self._read()

    def _tick(self) -> None:
        """Let paho send its pings and notice a silent broker; notice one that acknowledges nothing."""
        self._misc = self._loop.call_later(1.0, self._tick)
        if not 0 < self._client.pinged_for_s() < PONG_S:  # else paho waits for one keep-alive
            self._client.loop_misc()
        oldest_s = min((sent_s for _, sent_s in self._tickets.values()), default=self._loop.time())
        if self._loop.time() - oldest_s > ACK_S:
            self._lose(f"the broker has not acknowledged a message for {ACK_S:g} s")

    def _lose_with(self, notice: Event) -> None:
        self.notice = notice
        self._lose(notice.text)

    def _lose(self, reason: str) -> None:
        if not self.lost.done():
            self.lost.set_result(reason)

    # paho's callbacks; up to the end of `connect` those of the socket come from its thread.
    def _on_socket_open(self, _client: Any, _userdata: Any, sock: Any) -> None:
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def _on_socket_close(self, _client: Any, _userdata: Any, _sock: Any) -> None:
        self._release()

    def _on_socket_register_write(self, _client: Any, _userdata: Any, _sock: Any) -> None:
        if self._sock is not None:
            self._loop.call_soon(self._write)

    def _write(self) -> None:
        """Hand over what waits, as one piece: each on its own would wake the broker."""
        if self._sock is not None:
            self._sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_CORK, 1)
            self._client.loop_write()
        if self._sock is not None:
            self._sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_CORK, 0)
            if self._client.want_write():  # more than the socket takes
                self._loop.add_writer(self._sock, self._client.loop_write)

    def _on_socket_unregister_write(self, _client: Any, _userdata: Any, _sock: Any) -> None:
        if self._sock is not None:
            self._loop.remove_writer(self._sock)

    def _on_connect(
        self, _client: Any, _userdata: Any, _flags: Any, code: ReasonCode, properties: Any
    ) -> None:
        self.connack_code = code.value
        if code.is_failure:
            self._connack.set_exception(refused(self._settings.address, code.value, str(code)))
            return
        self.window = min(WINDOW, getattr(properties, "ReceiveMaximum", 65_535))
        self._max_packet = getattr(properties, "MaximumPacketSize", None)
        self._connack.set_result(None)

    def _on_subscribe(self, _client: Any, _userdata: Any, mid: int, codes: Any, _properties: Any) -> None:
        if (on_answer := self._subacks.pop(mid, None)) is not None:
            self._loop.call_soon(on_answer, all(code.value < FIRST_FAILURE for code in codes))

    def _on_skip(self, size: int) -> None:
        self._loop.call_soon(self._parts.on_skip, too_large(size, is_skipped=True))

    def _on_ack(self, packet_id: int, reason_code: int) -> None:
        ticket, _ = self._tickets.pop(packet_id, (None, 0.0))
        if ticket is not None:
            self._parts.on_ack(ticket, reason_code)

    def _on_message(self, _client: Any, _userdata: Any, message: paho.MQTTMessage) -> None:
        try:
            topic = message.topic
        except UnicodeDecodeError:
            return
        incoming = Incoming(
            topic=topic,
            payload=bytes(message.payload),
            is_retained=bool(message.retain),
            is_live=bool(message.retain) and self.version is Version.V5,
            expiry_s=getattr(message.properties, "MessageExpiryInterval", None),
            correlation=getattr(message.properties, "CorrelationData", None),
        )
        # Not from within paho: an error in a command must not damage its parser.
        self._loop.call_soon(self._parts.on_incoming, incoming)

    def _on_disconnect(
        self, _client: Any, _userdata: Any, flags: Any, code: ReasonCode, _properties: Any
    ) -> None:
        if flags.is_disconnect_packet_from_server and code.value == SESSION_TAKEN_OVER:
            self._lose_with(event_of(EventCode.CLIENT_ID_TAKEN, "seen", client_id=self._settings.client_id))
        elif flags.is_disconnect_packet_from_server:
            self._lose(f"the broker closed the connection: {code}")
        elif code.getName() == "Keep alive timeout":
            self._lose("the broker has stopped answering")
        else:
            self._lose(CONNECTION_LOST)


def _properties(packet_type: int) -> Properties:
    return Properties(packet_type)  # type: ignore[no-untyped-call]  # paho leaves it untyped
