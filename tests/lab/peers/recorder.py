"""A consumer that is subscribed to everything at QoS 1 and records what any contender publishes."""

from __future__ import annotations

import json
import time
from typing import Any

from paho.mqtt import client as paho

from tests.lab.peers.contenders import Contender
from tests.lab.peers.measure import Published
from tests.lab.torture import recorder


class PeerRecorder(recorder.Recorder):
    """The same session, that outlives its connections; but a publisher may have topics of his own."""

    def __init__(self, port: int, contender: Contender) -> None:
        super().__init__(port)
        self.published: list[Published] = []
        self.present_token = ""  # of a gateway that publishes one
        self._contender = contender

    def order(self, starter: str, verb: str, *, retain: bool = False) -> float:
        """Publish a start or stop; return when."""
        topic, payload = self._contender.order(starter, verb, self.present_token)
        sent_s = time.monotonic()
        self._client.publish(topic, payload, qos=1, retain=retain)
        return sent_s

    def _connected(self, client: paho.Client, *_: Any) -> None:
        client.subscribe("#", qos=1)

    def _take(self, client: paho.Client, userdata: Any, message: paho.MQTTMessage) -> None:
        received_s = time.monotonic()
        if "command" in message.topic or message.topic.endswith("/set"):
            return
        try:
            body = json.loads(message.payload) if message.payload else {}
            if message.topic.endswith("gateway/fresh"):
                self.present_token = body["token"]
            self.published.extend(self._contender.read(message.topic, body, received_s))
        except (ValueError, KeyError) as error:
            self.bad.append(f"{message.topic}: {error!r} {message.payload[:100]!r}")
