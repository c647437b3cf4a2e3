"""What two brokers' subscribers received, compared: nothing lost, each once, in order. Pure."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

PACKET_BYTES = 7  # of a PUBLISH of QoS 1 besides topic and payload, usually [MQTT 5 3.3]

Name = tuple[Any, ...]  # what names a message once and for all


class Arrival(NamedTuple):
    """One message, or one item of a batch of late values."""

    at_s: float
    name: Name
    is_numbered: bool  # the name is topic, boot and seq
    is_live: bool  # no late value, which comes after newer ones


class Received(NamedTuple):
    """One message as it arrived; topics without the prefix of the site."""

    at_s: float
    topic: str
    size: int
    is_retained: bool
    arrivals: tuple[Arrival, ...]  # nothing of a topic whose newest message alone counts

    @property
    def gateway(self) -> str:
        """Return the name of the gateway that published it."""
        return self.topic.split("/")[1]


def received(at_s: float, topic: str, payload: bytes, *, is_retained: bool) -> Received:
    """Return a message with what names it; KeyError or ValueError for one that is none of ours."""
    size = PACKET_BYTES + len(topic) + len(payload)
    return Received(at_s, topic, size, is_retained, tuple(_arrivals(at_s, topic, payload)))


def _arrivals(at_s: float, topic: str, payload: bytes) -> Iterable[Arrival]:
    if not payload or "/command/" in topic:
        return
    body = json.loads(payload)
    if topic.endswith("/history"):
        values = topic.removesuffix("history") + "value/"
        for item in body["items"]:
            yield Arrival(at_s, (values + item["point"], body["boot"], item["seq"]), True, is_live=False)
    elif "seq" in body and "boot" in body:
        yield Arrival(at_s, (topic, body["boot"], body["seq"]), True, is_live=True)
    elif "/result/" in topic:
        name = (topic, body["id"], body["phase"], body["duplicate"], body["time"])
        yield Arrival(at_s, name, False, is_live=True)


@dataclass(frozen=True)
class Verdict:
    """What the central subscriber's books say beside those of the site's."""

    messages: int  # with a name, each once
    repeated: int  # copies beyond the first
    lost: list[Name]  # the site's broker had them, the central one never
    foreign: list[Name]  # the other way round
    backwards: list[Name]  # first copies that came after a later message of their topic and run
    old_at_end: list[str]  # topics whose last copy is not their newest message
    holes: dict[tuple[str, str], list[int]]  # by gateway and run: numbers that never came

    def __str__(self) -> str:
        holes = sum(len(each) for each in self.holes.values())
        return (
            f"{self.messages} messages, {self.repeated} copies of them besides; lost {len(self.lost)},"
            f" foreign {len(self.foreign)}, backwards {len(self.backwards)} in {len(self.topics_backwards)}"
            f" topics, old at the end {len(self.old_at_end)}, numbers that no message has {holes}"
        )

    @property
    def topics_backwards(self) -> set[str]:
        """Return the topics of which something came out of order."""
        return {name[0] for name in self.backwards}

    @property
    def is_whole(self) -> bool:
        """Return whether every message came, and each topic ended with its newest."""
        return not (self.lost or self.foreign or self.old_at_end)


def verdict(site: Sequence[Received], central: Sequence[Received]) -> Verdict:
    """Compare what arrived at the site's broker with what arrived at the central one."""
    at_site = {arrival.name for each in site for arrival in each.arrivals}
    arrivals = [arrival for each in central for arrival in each.arrivals]
    found = {arrival.name for arrival in arrivals}
    return Verdict(
        messages=len(found),
        repeated=len(arrivals) - len(found),
        lost=sorted(at_site - found),
        foreign=sorted(found - at_site),
        backwards=backwards(arrivals),
        old_at_end=old_at_end(arrivals),
        holes=holes(arrivals),
    )


def differing(site: Mapping[str, bytes], central: Mapping[str, bytes], *, prefix: str) -> list[str]:
    """Return the topics that the two brokers do not hold alike, also those without a number."""
    there = {topic.removeprefix(prefix): payload for topic, payload in central.items()}
    return sorted(topic for topic in {*site, *there} if site.get(topic) != there.get(topic))


def backwards(arrivals: Iterable[Arrival]) -> list[Name]:
    """Return the live messages whose first copy came after a later one of the same topic and run."""
    newest: dict[Name, int] = {}
    seen: set[Name] = set()
    found = []
    for each in arrivals:
        if not each.is_numbered or not each.is_live or each.name in seen:
            continue
        seen.add(each.name)
        *of, seq = each.name
        if seq < newest.get(tuple(of), 0):
            found.append(each.name)
        newest[tuple(of)] = max(seq, newest.get(tuple(of), 0))
    return found


def old_at_end(arrivals: Iterable[Arrival]) -> list[str]:
    """Return the topics whose last live copy is older than another one of the same run."""
    newest: dict[tuple[str, str], int] = {}
    last: dict[str, tuple[str, int]] = {}
    for each in arrivals:
        if each.is_numbered and each.is_live:
            topic, boot, seq = each.name
            newest[topic, boot] = max(seq, newest.get((topic, boot), 0))
            last[topic] = boot, seq
    return sorted(topic for topic, (boot, seq) in last.items() if seq < newest[topic, boot])


def holes(arrivals: Iterable[Arrival]) -> dict[tuple[str, str], list[int]]:
    """Return by gateway and run the numbers below the highest that no message has."""
    numbers: defaultdict[tuple[str, str], set[int]] = defaultdict(set)
    for each in arrivals:
        if each.is_numbered:
            topic, boot, seq = each.name
            numbers[topic.split("/")[1], boot].add(seq)
    missing = {run: sorted(set(range(1, max(each))) - each) for run, each in numbers.items()}
    return {run: each for run, each in missing.items() if each}
