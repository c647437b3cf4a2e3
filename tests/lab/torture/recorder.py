"""A SCADA that forgets nothing: subscribed at QoS 1 to everything, it keeps books and gives commands."""

from __future__ import annotations

import json
import time
from collections import Counter
from typing import Any

from paho.mqtt import client as paho

from tests.lab.torture.books import Books
from tests.lab.torture.machine import until
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
        self.bad: list[str] = []  # what no consumer could read

    def publish(self, topic: str, payload: str | dict[str, Any] = "", *, retain: bool = False) -> None:
        super().publish(f"{BASE}/{topic}", payload, retain=retain)

    @property
    def token(self) -> str:
        """Return the present proof of freshness."""
        return str(self.latest.get("gateway/fresh", {}).get("token", "none"))

    @property
    def boot(self) -> str:
        """Return the name of the present connection."""
        return str(self.latest["gateway/status"]["boot"])

    def command(self, starter: str, verb: str, id_: str, **args: Any) -> None:
        self.publish(f"command/{starter}/alice/{verb}", {"id": id_, "token": self.token, "args": args})

    def newest(self, topic: str, since_s: float = 0.0) -> dict[str, Any]:
        """Return the newest message of a topic; nothing of one that came before that time."""
        found: dict[str, Any] = self.latest.get(topic, {})
        return found if self.received_s.get(topic, 0.0) >= since_s else {}

    async def until(self, topic: str, *, since_s: float = 0.0, within_s: float = 10.0, **wanted: Any) -> None:
        """Wait for a message that came after `since_s` and has these fields."""

        def fits() -> bool:
            newest = self.newest(topic, since_s)
            return bool(newest) and all(newest.get(key) == value for key, value in wanted.items())

        await until(fits, f"{topic} has {wanted}", within_s=within_s)

    def events_of(self, code: str, since_s: float) -> list[float]:
        """Return when the events of a code came, from a time on."""
        found = [each["received_s"] for each in self.events[:] if each["code"] == code]
        return [at_s for at_s in found if at_s >= since_s]

    async def final(self, id_: str, *, within_s: float = 20.0) -> dict[str, Any]:
        """Wait for a command's final result."""

        def finals() -> list[dict[str, Any]]:
            return [each for each in self.of(id_) if is_final(each)]

        await until(finals, f"command {id_} has a final result", within_s=within_s)
        return finals()[0]

    def of(self, id_: str, *, since: int = 0) -> list[dict[str, Any]]:
        """Return what was published of a command, from that result on."""
        return [each for each in self.results[since:] if each["id"] == id_]

    def finals_of_ids(self) -> Counter[str]:
        """Return how many final results each id has had, duplicates that say so left out.

        What comes again as it was counts once: its acknowledgement was not on the disk at a kill.
        """
        finals = [each for each in self.results[:] if each["id"] and is_final(each) and not each["duplicate"]]
        return Counter({json.dumps(each, sort_keys=True): each["id"] for each in finals}.values())

    def take(self, message: paho.MQTTMessage) -> None:
        topic = message.topic.removeprefix(f"{BASE}/")
        if topic.startswith("command/"):
            return
        try:
            body = json.loads(message.payload) if message.payload else {}
        except ValueError:
            self.bad.append(f"{topic}: {message.payload[:100]!r}")
            return
        self.latest[topic] = body
        self.received_s[topic] = time.monotonic()
        if "seq" in body:
            self.seqs.add(body["seq"])
        match topic.split("/"):
            case ["result", *_]:
                self.results.append(body)
            case [*_, "event"]:
                self.events.append({**body, "topic": topic, "received_s": self.received_s[topic]})
                self.books.event(self.events[-1])
            case ["starter", starter, "value", point] if body:
                self.books.value(starter, point, body)
                self._note_value(starter, point, body)
            case ["starter", starter, "history"]:
                self.books.history(topic, body)
                for item in body["items"]:
                    self.seqs.add(item["seq"])
                    self._note_value(starter, item["point"], item)

    def _note_value(self, starter: str, point: str, body: dict[str, Any]) -> None:
        if body["quality"] == "good":
            self.good.add((starter, point, json.dumps(body["value"])))


def is_final(result: dict[str, Any]) -> bool:
    """Return whether nothing follows this result."""
    return result["phase"] not in ("accepted", "written")
