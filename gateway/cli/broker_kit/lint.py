"""Looks for what is dangerous in a Mosquitto configuration, above all in its bridges; pure."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from itertools import zip_longest

_INWARDS = {False: ("in", "both"), True: ("out", "both")}  # the directions in which commands reach the edge
_TRUE = ("true", "1")  # all that Mosquitto takes for it
_OF_BROKER = ("allow_anonymous", "per_listener_settings")
_LOCAL = re.compile(r"(127\.[0-9.]+|localhost|\[::1\])(:[0-9]+)?")
_OWN_BRANCHES = ("gateway/#", "starter/#", "result/#", "audit")


@dataclass(slots=True)
class _Bridge:
    name: str
    line: int
    options: dict[str, str] = field(default_factory=dict)
    topics: list[tuple[int, str, str]] = field(default_factory=list)  # line, direction, filter at this broker

    @property
    def is_local(self) -> bool:
        """Return whether the other broker is on this machine: then this one is a bridge of its own."""
        given = f"{self.options.get('address', '')} {self.options.get('addresses', '')}".split()
        return bool(given) and all(_LOCAL.fullmatch(each) for each in given)


def warnings(text: str, base: str, remote: Collection[str] | None = None) -> Iterator[str]:
    """Yield what is dangerous for a gateway with this base, each as `line N: what (what to do)`.

    `remote` are the operators whose commands may come over a bridge; None: not looked at.
    """
    options, bridges = _read(text)
    is_each = [where for where, value in options.get("per_listener_settings", []) if value in _TRUE]
    if is_each:
        what = "per_listener_settings true: a list of passwords or rights counts for one listener alone"
        yield f"line {is_each[-1]}: {what} (leave it out)"
    anonymous = options.get("allow_anonymous", [])
    for number, value in anonymous if is_each else anonymous[-1:]:
        if value in _TRUE:
            what = "allow_anonymous true: who has no login may do what the access list grants to all"
            yield f"line {number}: {what} (write false)"
    for bridge in bridges:
        yield from _of_bridge(bridge, base)
        if remote is not None:
            yield from _undated(bridge, base, remote)


def overlap(one: str, other: str) -> bool:
    """Return whether some topic matches both filters."""
    for level, its in zip_longest(one.split("/"), other.split("/")):
        if "#" in (level, its):
            return True
        if None in (level, its) or (level != its and "+" not in (level, its)):
            return False
    return True


def _undated(bridge: _Bridge, base: str, remote: Collection[str]) -> Iterator[str]:
    """Yield topics that let commands in of operators who may prove them fresh by a token."""
    commands = f"{base}/command/"
    for line, direction, topic in bridge.topics:
        if not overlap(topic, f"{commands}#") or direction not in _INWARDS[bridge.is_local]:
            continue
        client = f"{topic.removeprefix(commands)}/".split("/")[1] if topic.startswith(commands) else ""
        if client not in remote:
            what = f'{topic} lets in commands of others than operators with freshness = "issued_at"'
            yield f"line {line}: connection {bridge.name}: {what} (let in command/+/OPERATOR/+ alone)"


def _of_bridge(bridge: _Bridge, base: str) -> Iterator[str]:
    commands, has_commands = f"{base}/command/#", False
    for line, direction, topic in bridge.topics:
        where = f"line {line}: connection {bridge.name}"
        is_command = overlap(topic, commands)
        is_own = any(overlap(topic, f"{base}/{branch}") for branch in _OWN_BRANCHES)
        has_commands = has_commands or (is_command and direction in _INWARDS[bridge.is_local])
        # The bridge's own way to the edge's broker:
        is_narrow = bridge.is_local and not (is_command and is_own)
        if is_command and direction != "in" and not is_narrow:
            what = f"{topic} sends commands out, those that came in by a bridge too: an endless storm"
            yield f"{where}: {what} (name the topics: gateway/#, starter/#, result/#, audit)"
        if is_own and direction != "out" and not is_narrow:
            what = f"{topic} lets the other broker write what only the gateway may"
            yield f"{where}: {what} (let in command/+/OPERATOR/+ alone)"
    if has_commands:
        where = f"line {bridge.line}: connection {bridge.name}"
        if bridge.options.get("cleansession", "false") not in _TRUE:
            what = "commands that were sent while the link was cut are delivered late"
            yield f"{where}: {what} (cleansession true)"
        if bridge.options.get("bridge_protocol_version", "mqttv311") != "mqttv50":
            what = "MQTT 3.1.1 passes no expiry of commands on"
            yield f"{where}: {what} (bridge_protocol_version mqttv50)"


def _read(text: str) -> tuple[dict[str, list[tuple[int, str]]], list[_Bridge]]:
    """Return the broker's options with each line that has them, and the connections."""
    options: dict[str, list[tuple[int, str]]] = {}
    bridges: list[_Bridge] = []
    for number, line in enumerate(text.splitlines(), 1):
        key, _, value = line.strip().partition(" ")
        value = value.strip()
        if not key or key.startswith("#"):
            continue
        if key == "connection":
            bridges.append(_Bridge(value, number))
        elif key == "topic" and bridges:
            bridges[-1].topics.append((number, *_topic(value)))
        elif bridges:
            bridges[-1].options[key] = value
        if key in _OF_BROKER:  # also behind a connection
            options.setdefault(key, []).append((number, value))
    return options, bridges


def _topic(value: str) -> tuple[str, str]:
    """Return direction and local filter of `PATTERN [DIRECTION [QOS [LOCAL_PREFIX [REMOTE_PREFIX]]]]`."""
    pattern, *rest = value.split()
    direction = rest[0] if rest else "out"
    prefix = rest[2] if len(rest) > 2 and rest[2] != '""' else ""
    return direction, prefix + ("" if pattern == '""' else pattern)
