"""paho's client, with a limit of the packets that it stores, and without its own store of messages.

How large a packet may be: MQTT 5 lets a client ask the broker to hold larger ones back; MQTT 3.1.1 does not,
and a broker may ignore it.

paho keeps each message until it is acknowledged, with locks and conditions for other threads, and repeats it
on its next connection. A session has one connection, and the outbox keeps the messages.
"""

from __future__ import annotations

import ssl
import struct
import time
from collections.abc import Callable
from typing import Any, Self

from paho.mqtt import client as paho
from paho.mqtt.enums import MQTTErrorCode
from paho.mqtt.properties import Properties

from gateway.contract import Event, EventCode, event_of
from gateway.mqtt.message import Message

MAX_INCOMING_BYTES = 65_536  # asked of the broker; commands are 4 KB at most
MOST_SKIPPED_BYTES = 1_048_576  # of a larger packet its beginning is stored; beyond this it ends the session
READ_AHEAD_BYTES = 4096  # paho asks for each packet in three pieces
RETAIN = 0x01  # in a PUBLISH's first byte [MQTT3 3.3.1.3]


class TooLargeError(Exception):
    """The broker announced more than is taken; carries its size. An OSError would not come out of paho."""

    def __init__(self, size: int) -> None:
        self.size = size
        super().__init__(size)


class SessionClient(paho.Client):
    """The client of one session.

    It reads over a packet that is too large, and says so to `on_skip`. One that is larger than
    MOST_SKIPPED_BYTES would hold up what comes after it, and ends the session (TooLargeError); unless it is
    retained, since the next session would get it too. `on_ack` is called with the packet id and the reason
    code of each PUBACK.
    """

    on_skip: Callable[[int], None]
    on_ack: Callable[[int, int], None]
    _ahead = b""  # read of the socket, and not asked for yet

    @property
    def has_more(self) -> bool:
        """Return whether there is more to read, although the socket may not be readable."""
        sock = self._sock
        return bool(self._ahead) or (isinstance(sock, ssl.SSLSocket) and sock.pending() > 0)

    def pinged_for_s(self) -> float:
        """Return for how long a ping has been without its answer; 0 for none."""
        return time.monotonic() - self._ping_t if self._ping_t else 0.0

    def send(self, message: Message, properties: Properties | None = None) -> int:
        """Have a message written, and return its packet id; only while connected."""
        packet_id = self._mid_generate()
        topic = message.topic.encode()
        info = None if message.qos else paho.MQTTMessageInfo(packet_id)
        self._send_publish(
            packet_id, topic, message.payload, message.qos, message.retain, info=info, properties=properties
        )
        return packet_id

    def _handle_pubackcomp(self, _name: str) -> MQTTErrorCode:
        """Read a PUBACK: its packet id, and in MQTT 5 perhaps a reason code [MQTT5 3.4.2]."""
        body = self._in_packet["packet"]
        (packet_id,) = struct.unpack_from(">H", body)
        self.on_ack(packet_id, body[2] if body[2:] else 0)
        return MQTTErrorCode.MQTT_ERR_SUCCESS

    def _sock_recv(self, bufsize: int) -> bytes:
        """Read so much at most; for a packet's body paho first asks for its whole announced length."""
        if bufsize > MAX_INCOMING_BYTES:
            packet = self._in_packet
            if not isinstance(packet["packet"], _Beginning):
                is_retained = bool(packet["command"] & RETAIN)
                if bufsize > MOST_SKIPPED_BYTES and not is_retained:
                    raise TooLargeError(bufsize)
                packet["packet"] = _Beginning()
                self.on_skip(bufsize)
        if not self._ahead:
            self._ahead = super()._sock_recv(max(min(bufsize, MAX_INCOMING_BYTES), READ_AHEAD_BYTES))
        data, self._ahead = self._ahead[:bufsize], self._ahead[bufsize:]
        return data


class _Beginning(bytearray):
    """The body of a packet that is too large, as far as it is stored: its topic, and more than is taken."""

    def __iadd__(self, data: Any) -> Self:  # type: ignore[misc]  # paho adds in place only
        """Add what there is room for."""
        self.extend(data[: 2 * MAX_INCOMING_BYTES - len(self)])
        return self


def too_large(size: int, *, is_skipped: bool) -> Event:
    """Return what is wrong with a packet from the broker: it was read over, or has ended the connection."""
    return event_of(
        EventCode.MESSAGE_TOO_LARGE,
        "skipped" if is_skipped else "announced",
        size=size,
        limit=MAX_INCOMING_BYTES,
    )
