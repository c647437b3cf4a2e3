"""A SCADA that forgets nothing: subscribed at QoS 1 to everything, it keeps books and gives commands."""

from __future__ import annotations

import json
import time
from collections import Counter
from typing import Any

from paho.mqtt import client as paho

from tests.lab.torture.books import Books
from tests.lab.torture.waiting import until
from tests.listener import BrokerListener

BASE = "starters/plant"


class Recorder(BrokerListener):
    """One client with a session that outlives its connections."""

    def __init__(self, port: int) -> None:
        super().__init__(port, f"{BASE}/#", "recorder")
        self.latest: dict[str, Any] = {}
        self.received_s: dict[str, float] = {}
        self.events: list[dict[str, Any]] = []
        self.results: list[dict[str, Any]] = []
        self.good: set[tuple[str, str, str]] = set()  # starter, point, value as JSON
        self.books = Books()
        self.seqs: set[int] = set()  # of whatever has one
        self.messages = 0
        self.bad: list[str] = []  # what no consumer could read

    def publish(self, topic: str, payload: str | dict[str, Any] = "", *, retain: bool = False) -> None:
        super().publish(f"{BASE}/{topic}", payload, retain=retain)

    @property
    def token(self) -> str:
        """Return the present proof of freshness."""
        return str(self.latest.get("gateway/fresh", {}).get("token", "none"))

    def command(self, starter: str, verb: str, id_: str, **args: Any) -> None:
        self.publish(f"command/{starter}/alice/{verb}", {"id": id_, "token": self.token, "args": args})

    async def until(
        self, topic: str, *, since_s: float = 0.0, within_s: float = 10.0, **wanted: Any
    ) -> float:
        """Wait for a message that came after `since_s` and has these fields; return when it came."""

        def fits() -> bool:
            latest = self.latest.get(topic)
            is_new = self.received_s.get(topic, 0.0) >= since_s
            return is_new and latest is not None and all(latest.get(k) == v for k, v in wanted.items())

        await until(fits, f"{topic} has {wanted}", within_s=within_s)
        return self.received_s[topic]

    async def event(self, code: str, *, since_s: float, within_s: float) -> float:
        """Wait for an event that came after `since_s`; return when it came."""

        def found() -> list[float]:
            came_s = [each["received_s"] for each in self.events[:] if each["code"] == code]
            return [at_s for at_s in came_s if at_s >= since_s]

        await until(lambda: bool(found()), f"event {code}", within_s=within_s)
        return found()[0]

    async def final(self, id_: str, *, within_s: float = 20.0) -> dict[str, Any]:
        """Wait for a command's final result."""

        def finals() -> list[dict[str, Any]]:
            return [each for each in self.results[:] if each["id"] == id_ and is_final(each)]

        await until(lambda: bool(finals()), f"command {id_} has a final result", within_s=within_s)
        return finals()[0]

    def of(self, id_: str, *, since: int = 0) -> list[dict[str, Any]]:
        """Return what was published of a command, from that result on."""
        return [each for each in self.results[since:] if each["id"] == id_]

    def finals_of_ids(self) -> Counter[str]:
        """Return how many final results each id has had, duplicates that say so left out.

        What comes again as it was counts once: its acknowledgement was not on the disk at a kill.
        """
        finals = [each for each in self.results[:] if each["id"] and is_final(each) and not each["duplicate"]]
        distinct = {json.dumps(each, sort_keys=True): each["id"] for each in finals}
        return Counter(distinct.values())

    def take(self, message: paho.MQTTMessage) -> None:
        topic = message.topic.removeprefix(f"{BASE}/")
        if topic.startswith("command/"):
            return
        self.messages += 1
        try:
            body = json.loads(message.payload) if message.payload else {}
        except ValueError:
            self.bad.append(f"{topic}: {message.payload[:100]!r}")
            return
        self.latest[topic] = body
        self.received_s[topic] = time.monotonic()
        self._book(topic, body)

    def _book(self, topic: str, body: dict[str, Any]) -> None:
        if "seq" in body:
            self.seqs.add(body["seq"])
        if topic.endswith("/event"):
            event = {**body, "topic": topic, "received_s": self.received_s[topic]}
            self.events.append(event)
            self.books.event(event)
        elif topic.startswith("result/"):
            self.results.append(body)
        elif "/value/" in topic and body:
            _, starter, _, point = topic.split("/")
            self.books.value(starter, point, body)
            if body["quality"] == "good":
                self.good.add((starter, point, json.dumps(body["value"])))
        elif topic.endswith("/history"):
            self.books.history(topic, body)
            starter = topic.split("/")[1]
            for item in body["items"]:
                self.seqs.add(item["seq"])
                if item["quality"] == "good":
                    self.good.add((starter, item["point"], json.dumps(item["value"])))


def is_final(result: dict[str, Any]) -> bool:
    """Return whether nothing follows this result."""
    return result["phase"] not in ("accepted", "written")
