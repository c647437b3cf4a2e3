"""What retained topics cost a Mosquitto: those of one gateway, published under many gateways' names."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from tests.lab.usage import Usage, usage
from tests.mosquitto import MosquittoBroker

MOST_WAITING = 2000  # messages that were not acknowledged yet
PATIENCE_S = 60.0


@dataclass(frozen=True)
class Filled:
    """A broker with nothing but retained topics."""

    gateways: int
    topics: int
    before: Usage
    after: Usage
    seconds: float

    @property
    def kib_a_thousand(self) -> float:
        """Return the memory of a thousand topics."""
        return (self.after.rss_kib - self.before.rss_kib) / self.topics * 1000

    @property
    def us_a_message(self) -> float:
        """Return the broker's processor time to take, store and acknowledge one message of QoS 1."""
        return (self.after.cpu_s - self.before.cpu_s) / self.topics * 1e6


def fill(folder: Path, messages: Mapping[str, bytes], *, name: str, gateways: int) -> Filled:
    """Publish the retained messages of the gateway `name` for so many gateways."""
    broker = MosquittoBroker(folder, options=("log_type none", "set_tcp_nodelay true"))
    broker.start()
    try:
        before, begun_s = usage(broker.pid), time.monotonic()
        client = paho.Client(CallbackAPIVersion.VERSION2)
        client.max_inflight_messages_set(MOST_WAITING)
        client.connect("127.0.0.1", broker.port)
        client.loop_start()
        for number in range(gateways):
            for topic, payload in messages.items():
                other = topic.replace(f"/{name}/", f"/{name}-{number:04}/", 1)
                last = client.publish(other, payload, qos=1, retain=True)
            last.wait_for_publish(PATIENCE_S)
        seconds = time.monotonic() - begun_s
        client.disconnect()
        client.loop_stop()
        return Filled(gateways, gateways * len(messages), before, usage(broker.pid), seconds)
    finally:
        broker.kill()
