"""What a consumer can derive from `boot` and `seq`: what came twice, out of order, or not at all."""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import Any

BESIDE = ("topic", "received_s")  # what the recorder has added


class Books:
    """Events and histories of all runs, as they came in."""

    def __init__(self) -> None:
        self.first: dict[tuple[str, int], dict[str, Any]] = {}  # events by boot and seq
        self.repeated = 0  # events that came again, the same
        self.wrong: list[str] = []
        self.published_late = 0  # values, in histories
        self._latest: dict[str, int] = {}  # seq of the latest new event, by boot
        self._history: defaultdict[tuple[str, str, str], int] = defaultdict(int)  # seq, by topic, boot, point
        self._live: set[tuple[str, str, int, str | None]] = set()  # starter, point, seq, time
        self._items: set[tuple[str, str, int]] = set()  # values published late: topic, boot, seq

    def event(self, body: dict[str, Any]) -> None:
        """Take an event: new ones of one run come in order, old ones again word for word."""
        key = boot, seq = body["boot"], body["seq"]
        before = self.first.get(key)
        if before is not None:
            self.repeated += 1
            if _said(before) != _said(body):
                self.wrong.append(f"boot and seq {key} name two events: {before}, {body}")
            return
        if seq < self._latest.get(boot, 0):
            self.wrong.append(f"event {key} came after {self._latest[boot]}")
        self._latest[boot] = seq
        self.first[key] = body

    def value(self, starter: str, point: str, body: dict[str, Any]) -> None:
        """Take a value that was published live; after a broken connection the history may repeat it."""
        if body["time"] is not None:  # before the first reading all runs say the same
            self._live.add((starter, point, body["seq"], body["time"]))

    def history(self, topic: str, body: dict[str, Any]) -> None:
        """Take a history: what is new in it is younger than all before of that point and run."""
        boot, starter = body["boot"], topic.split("/")[1]
        for item in body["items"]:
            key = (topic, boot, item["seq"])
            if key in self._items or (starter, item["point"], item["seq"], item["time"]) in self._live:
                self.repeated += 1
                continue
            line = (topic, boot, item["point"])
            if item["seq"] < self._history[line]:
                self.wrong.append(f"{topic} {item['point']}: {item['seq']} came after {self._history[line]}")
            self._history[line] = item["seq"]
            self._items.add(key)
            self.published_late += 1

    def faults_of(self, starter: str) -> int:
        """Return how many different events of faults a starter had."""
        topic = f"starter/{starter}/event"
        return sum((each["code"], each["topic"]) == ("fault", topic) for each in tuple(self.first.values()))


def unfinished(results: list[dict[str, Any]]) -> list[str]:
    """Return the ids of commands that were accepted, but have no final result."""
    phases: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for each in results:
        phases[each["id"]][each["phase"]] += 1
    under_way = {"accepted", "written"}
    return [id_ for id_, seen in phases.items() if id_ and seen.keys() <= under_way]


def _said(body: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in body.items() if key not in BESIDE}
