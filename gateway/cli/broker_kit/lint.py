"""Looks for what is dangerous in a Mosquitto configuration, above all in its bridges; pure."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from itertools import zip_longest

_TRUE = ("true", "1")  # all that Mosquitto takes for it
_LOCAL = re.compile(r"(127\.[0-9.]+|localhost|\[::1\])(:[0-9]+)?")
_OWN_BRANCHES = ("gateway/#", "starter/#", "result/#", "audit")

Line = tuple[int, str, str]  # its number, key and value


def overlap(one: str, other: str) -> bool:
    """Return whether some topic matches both filters."""
    for level, its in zip_longest(one.split("/"), other.split("/")):
        if "#" in (level, its):
            return True
        if None in (level, its) or (level != its and "+" not in (level, its)):
            return False
    return True


def warnings(text: str, base: str, remote: Collection[str] | None = None) -> Iterator[str]:
    """Yield what is dangerous for a gateway with this base, each as `line N: what (what to do)`.

    `remote` are the operators whose commands may come over a bridge; None: not looked at.
    """
    lines: list[Line] = []
    for number, line in enumerate(text.splitlines(), 1):
        key, _, value = line.strip().partition(" ")
        if key and not key.startswith("#"):
            lines.append((number, key, value.strip()))
    each = [number for number, key, value in lines if key == "per_listener_settings" and value in _TRUE]
    if each:
        what = "per_listener_settings true: a list of passwords or rights counts for one listener alone"
        yield f"line {each[-1]}: {what} (leave it out)"
    anonymous = [(number, value) for number, key, value in lines if key == "allow_anonymous"]
    for number, value in anonymous if each else anonymous[-1:]:
        if value in _TRUE:
            what = "allow_anonymous true: who has no login may do what the access list grants to all"
            yield f"line {number}: {what} (write false)"
    starts = [place for place, line in enumerate(lines) if line[1] == "connection"]
    for start, end in zip_longest(starts, starts[1:]):
        yield from _of_bridge(lines[start:end], base, remote)


def _of_bridge(lines: list[Line], base: str, remote: Collection[str] | None) -> Iterator[str]:
    """Yield what is dangerous in one connection, in its topics first."""
    (first, _, name), options = lines[0], {key: value for _, key, value in lines}
    addresses = f"{options.get('address', '')} {options.get('addresses', '')}".split()
    # A bridge to this machine is one beside the broker, which it commands by what goes out.
    is_local = bool(addresses) and all(_LOCAL.fullmatch(address) for address in addresses)
    commands, inwards, has_commands = f"{base}/command/", "out" if is_local else "in", False
    for number, value in [(number, value) for number, key, value in lines if key == "topic"]:
        direction, topic = _topic(value)
        is_command = overlap(topic, f"{commands}#")
        is_own = any(overlap(topic, f"{base}/{branch}") for branch in _OWN_BRANCHES)
        is_narrow = is_local and not (is_command and is_own)
        said = []
        if is_command and direction != "in" and not is_narrow:
            what = f"{topic} sends commands out, those that came in by a bridge too: an endless storm"
            said.append(f"{what} (name the topics: gateway/#, starter/#, result/#, audit)")
        if is_own and direction != "out" and not is_narrow:
            what = f"{topic} lets the other broker write what only the gateway may"
            said.append(f"{what} (let in command/+/OPERATOR/+ alone)")
        if is_command and direction in (inwards, "both"):
            has_commands = True
            client = topic.removeprefix(commands).split("/")[1:2] if topic.startswith(commands) else []
            if remote is not None and not set(client) & set(remote):
                what = f'{topic} lets in commands of others than operators with freshness = "issued_at"'
                said.append(f"{what} (let in command/+/OPERATOR/+ alone)")
        yield from (f"line {number}: connection {name}: {each}" for each in said)
    if has_commands and options.get("cleansession") not in _TRUE:
        what = "commands that were sent while the link was cut are delivered late"
        yield f"line {first}: connection {name}: {what} (cleansession true)"
    if has_commands and options.get("bridge_protocol_version") != "mqttv50":
        what = "MQTT 3.1.1 passes no expiry of commands on"
        yield f"line {first}: connection {name}: {what} (bridge_protocol_version mqttv50)"


def _topic(value: str) -> tuple[str, str]:
    """Return direction and local filter of `PATTERN [DIRECTION [QOS [LOCAL_PREFIX [REMOTE_PREFIX]]]]`."""
    pattern, direction, _, prefix = (*value.split()[:4], *("", "out", "", "")[len(value.split()) :])
    return direction, prefix.replace('""', "") + pattern.replace('""', "")
