"""A client of a real broker that keeps what it gets; paho's thread takes the messages."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

from paho.mqtt import client as paho
from paho.mqtt.enums import CallbackAPIVersion


class BrokerListener:
    """Connects with `start`, again after 0.1 s; with a name its session outlives its connections."""

    def __init__(
        self,
        port: int,
        topics: str,
        name: str = "",
        *,
        user: tuple[str, str] | None = None,
        ca: Path | None = None,
    ) -> None:
        self._address = "localhost" if ca else "127.0.0.1", port
        self._client = paho.Client(
            CallbackAPIVersion.VERSION2, name, protocol=paho.MQTTv311, clean_session=not name
        )
        self._client.on_connect = lambda *_: self._client.subscribe(topics, qos=1)
        self._is_subscribed = threading.Event()
        self._client.on_subscribe = lambda *_: self._is_subscribed.set()
        self._client.on_message = lambda *call: self.take(call[2])
        self._client.reconnect_delay_set(0.1, 0.1)  # before the gateway
        if user is not None:
            self._client.username_pw_set(*user)
        if ca is not None:
            self._client.tls_set(str(ca))

    def start(self) -> None:
        """Connect, and wait until what is published from now on will come."""
        self._client.connect(*self._address, keepalive=30)
        self._client.loop_start()
        assert self._is_subscribed.wait(10.0), "no answer to the subscription"

    def stop(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()

    def publish(self, topic: str, payload: str | dict[str, Any] = "", *, retain: bool = False) -> None:
        """Publish a text, or what becomes JSON."""
        body = payload if isinstance(payload, str) else json.dumps(payload)
        self._client.publish(topic, body, qos=1, retain=retain)

    def take(self, message: paho.MQTTMessage) -> None:
        """Take a message, on paho's thread."""
        raise NotImplementedError
