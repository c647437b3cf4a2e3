"""A subscriber that counts everything, with a session that its broker stores; it commands too."""

from __future__ import annotations

import json
import time
import uuid
from collections import Counter
from types import TracebackType
from typing import Any

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.subscribeoptions import SubscribeOptions

from gateway.contract import Phase
from tests.lab.fleet.books import Name, Received, received
from tests.lab.fleet.site import OPERATOR

PATIENCE_S = 10.0
FINAL = (Phase.CONFIRMED, Phase.REJECTED, Phase.FAILED, Phase.UNCONFIRMED)


class Subscriber:
    """Everything below `base`, in the order of its arrival; what is retained already is not asked for."""

    def __init__(self, port: int, *, base: str, prefix: str = "") -> None:
        self.taken: list[Received] = []
        self.latest: dict[str, dict[str, Any]] = {}  # of the topics that a commander needs
        self.ends: Counter[str] = Counter()  # of commands, by phase and code
        self.names: dict[Name, float] = {}  # of messages, and when the first copy came
        self._is_ready: dict[str, set[str]] = {"state": set(), "info": set()}
        self._port = port
        self._base = prefix + base
        self._prefix = prefix
        self._client = paho.Client(
            CallbackAPIVersion.VERSION2, f"counter-{uuid.uuid4().hex[:6]}", protocol=paho.MQTTv5
        )

    def __enter__(self) -> Subscriber:
        session = Properties(PacketTypes.CONNECT)
        session.SessionExpiryInterval = 0xFFFFFFFF
        self._client.on_connect = self._subscribe
        self._client.on_message = self._take
        self._client.connect("127.0.0.1", self._port, keepalive=60, clean_start=True, properties=session)
        self._client.loop_start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._client.disconnect()
        self._client.loop_stop()

    def command(self, gateway: str, starter: str, verb: str) -> None:
        """Send a command with the newest proof of freshness that has arrived."""
        base = f"{self._base}{gateway}"
        token = self.latest[f"{gateway}/gateway/fresh"]["token"]
        payload = json.dumps({"id": uuid.uuid4().hex, "token": token})
        self._client.publish(f"{base}/command/{starter}/{OPERATOR}/{verb}", payload, qos=1)

    @property
    def ready(self) -> set[str]:
        """Return the starters that were ready once, and identified: gateway/starter."""
        return self._is_ready["state"] & self._is_ready["info"]

    def missing_of(self, other: Subscriber, until_s: float) -> int:
        """Return how much with a name that the other had until then has not arrived here."""
        return sum(name not in self.names for name, at_s in other.names.copy().items() if at_s < until_s)

    def reached_s(self, other: Subscriber, until_s: float) -> float:
        """Return when the last had arrived here of what the other had until then; `until_s`: nothing has."""
        before = [name for name, at_s in other.names.copy().items() if at_s < until_s]
        return max((self.names[name] for name in before if name in self.names), default=until_s)

    def most_copies(self, from_s: float) -> int:
        """Return how many copies of one value came since then, at most."""
        copies = Counter(
            arrival.name for each in list(self.taken) if each.at_s >= from_s for arrival in each.arrivals
        )
        return max(copies.values(), default=0)

    def between(self, from_s: float, to_s: float) -> list[Received]:
        """Return what arrived in a span of time."""
        return [each for each in list(self.taken) if from_s <= each.at_s < to_s]

    def _subscribe(self, *_: Any) -> None:
        options = SubscribeOptions(qos=1, retainHandling=SubscribeOptions.RETAIN_DO_NOT_SEND)
        self._client.subscribe(f"{self._base}#", options=options)

    def _take(self, _client: Any, _data: Any, message: paho.MQTTMessage) -> None:
        topic = message.topic.removeprefix(self._prefix)
        taken = received(time.monotonic(), topic, message.payload, is_retained=message.retain)
        self.taken.append(taken)
        for arrival in taken.arrivals:
            self.names.setdefault(arrival.name, taken.at_s)
        gateway, _, rest = topic.removeprefix("starters/").partition("/")
        if rest in ("gateway/fresh", "gateway/status"):
            self.latest[f"{gateway}/{rest}"] = json.loads(message.payload)
        elif rest.startswith("result/"):
            body = json.loads(message.payload)
            if body["phase"] in FINAL:
                self.ends[f"{body['phase']}: {body['code']}"] += 1
        elif rest.startswith("starter/") and rest.endswith(("/state", "/info")):
            self._note_ready(gateway, rest, message.payload)

    def _note_ready(self, gateway: str, rest: str, payload: bytes) -> None:
        _, starter, kind = rest.split("/")
        body = json.loads(payload or "{}")
        if body.get("state") == "ready" or body.get("firmware"):
            self._is_ready[kind].add(f"{gateway}/{starter}")


def retained(port: int, base: str) -> dict[str, bytes]:
    """Return the retained messages below `base`; what is published meanwhile is left out."""
    found: dict[str, bytes] = {}
    last_s = [time.monotonic()]

    def take(_client: Any, _data: Any, message: paho.MQTTMessage) -> None:
        if message.retain:
            found[message.topic] = message.payload
            last_s[0] = time.monotonic()

    client = paho.Client(CallbackAPIVersion.VERSION2, protocol=paho.MQTTv5)
    client.on_message = take
    client.connect("127.0.0.1", port)
    client.subscribe(f"{base}#", qos=0)
    client.loop_start()
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < min(end_s, last_s[0] + 1.0):
        time.sleep(0.05)
    client.disconnect()
    client.loop_stop()
    return found
