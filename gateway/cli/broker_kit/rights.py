"""Who may write and read which topics at the broker, for every configuration; pure.

The access list, the bridge's topics and the expectations of `--prove` all follow from `_rights`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import get_args
from urllib.parse import urlsplit

from gateway.config import SCHEMES, Config, SparkplugTable, Verb
from gateway.plugins.sparkplug.settings import NAMESPACE, state_topic

PROBE = "acl-probe"  # a starter, and an operator, that does not exist, for the proof
VERBS = tuple(verb for verb in get_args(Verb) if verb != "*")

_OF_NODE = ("NBIRTH", "NDATA", "NDEATH")
_OF_DEVICES = ("DBIRTH", "DDATA", "DDEATH")


class Role(StrEnum):
    """What a login is for; one may have several."""

    GATEWAY = "gateway"
    OPERATOR = "operator"
    VIEWER = "viewer"
    AUDITOR = "auditor"
    HOME_ASSISTANT = "Home Assistant"
    SPARKPLUG_NODE = "Sparkplug node"
    SPARKPLUG_HOST = "Sparkplug host"
    BRIDGE_UP = "bridge, telemetry"
    BRIDGE_DOWN = "bridge, commands"
    PROVER = "prover"


_ROLES = dict(zip("GOVAHNSUDP", Role, strict=True))


@dataclass(slots=True)
class Login:
    """One login, which has one connection at a time."""

    name: str
    client: str = ""  # of an [[operator]]: its level in command and result topics
    roles: set[Role] = field(default_factory=set)
    reads: list[str] = field(default_factory=list)  # topic filters
    writes: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class TriedTopic:
    """One topic to try; all logins but its writers and readers must be refused."""

    name: str
    what: str  # is published there
    is_real: bool  # the topic of something that exists: who may write there does not try it
    writers: frozenset[str]  # logins
    readers: frozenset[str]


def give_rights(logins: Iterable[Login], config: Config, central_base: str) -> None:
    """Give each login the filters of its roles; `central_base` is empty without a bridge."""
    for topic, writers, readers, client in _rights(config, central_base):
        for login in logins:
            others = {Role.OPERATOR} if client and client != login.client else set()
            for letters, filters in ((writers, login.writes), (readers, login.reads)):
                if {_ROLES[letter] for letter in letters} & (login.roles - others):
                    filters.append(topic)


def tried_topics(config: Config, logins: Sequence[Login]) -> tuple[TriedTopic, ...]:
    """Return the topics that the proof tries; of what exists only for those who must be refused.

    A list may have a line for one real starter alone.
    """

    def taking(topic: str, key: str) -> frozenset[str]:
        return frozenset(
            each.name for each in logins if any(_takes(rule, topic) for rule in getattr(each, key))
        )

    return tuple(
        TriedTopic(topic, what, is_real, taking(topic, "writes"), taking(topic, "reads"))
        for is_real, names in ((False, (PROBE,)), (True, [each.name for each in config.starters]))
        for topic, what in _tried(config, names, is_real=is_real)
    )


def sparkplug_here(config: Config) -> SparkplugTable | None:
    """Return the table of Sparkplug when this broker is (one of) its servers."""
    table = config.sparkplug
    if table is None or not table.urls:
        return table
    here = config.mqtt.host, config.mqtt.port
    ends = [(parts.hostname, parts.port or SCHEMES[parts.scheme]) for parts in map(urlsplit, table.urls)]
    return table if here in ends else None


def remote_clients(config: Config) -> tuple[str, ...]:
    """Return the operators whose commands may pass a bridge: those of `freshness = "issued_at"` alone."""
    by_token = {each.client for each in config.operators if each.freshness != "issued_at"}
    return tuple(dict.fromkeys(each.client for each in config.operators if each.client not in by_token))


def _rights(config: Config, central_base: str) -> Iterator[tuple[str, str, str, str]]:
    """Yield filters with their writers and readers, letters of `_ROLES`, and of which operator alone O is."""
    base, remote = config.base, remote_clients(config)
    yield f"{base}/starter/#", "G", "OVHU", ""
    yield f"{base}/starter/+/event", "", "A", ""
    yield f"{base}/gateway/#", "G", "OVHU", ""
    yield f"{base}/gateway/event", "", "A", ""
    yield f"{base}/audit", "G", "AU", ""
    yield f"{base}/result/#", "G", "U", ""
    for client in _clients(config):
        yield f"{base}/result/+/{client}", "", "O", client
        yield f"{base}/command/+/{client}/#", "O", "", client
    for client in remote:
        yield f"{base}/command/+/{client}/+", "D", "", ""
    yield f"{base}/#", "", "GP", ""
    yield f"{PROBE}/#", "", "P", ""
    if (home := config.home_assistant) is not None:
        is_passing = central_base == base  # discovery names the edge's topics, which must be the same there
        prefix = home.discovery_prefix
        yield f"{prefix}/device/+/config", "G", "U" if is_passing else "", ""
        yield f"{prefix}/#", "", "HP", ""
        yield home.birth_topic or f"{prefix}/status", "HD" if is_passing else "H", "GHP", ""
    if (spb := sparkplug_here(config)) is not None:
        group, node = f"{NAMESPACE}/{spb.group}", spb.node or config.gateway.name
        for topic in (
            *(f"{each}/{node}" for each in _OF_NODE),
            *(f"{each}/{node}/+" for each in _OF_DEVICES),
        ):
            yield f"{group}/{topic}", "N", "U", ""
        yield f"{group}/NCMD/{node}", "SD", "N", ""
        if spb.commands:
            yield f"{group}/DCMD/{node}/+", "SD" if spb.operator in remote else "S", "N", ""
        yield f"{group}/#", "", "S", ""
        yield f"{NAMESPACE}/#", "", "P", ""
        if spb.primary_host is not None:
            yield state_topic(spb.primary_host), "S", "NS", ""


def _tried(config: Config, starters: Iterable[str], *, is_real: bool) -> Iterator[tuple[str, str]]:
    """Yield topics to try, and what is published there: those of the probe, or of what exists."""
    base, home, spb = config.base, config.home_assistant, sparkplug_here(config)
    group, node = f"{NAMESPACE}/{spb.group if spb else ''}", (spb and spb.node) or config.gateway.name
    for starter in starters:
        yield f"{base}/starter/{starter}/state", "what a starter does"
        for client in _clients(config):
            for verb in ("start",) if is_real else VERBS:
                yield f"{base}/command/{starter}/{client}/{verb}", f"commands of {client}"
        if spb is not None:
            yield f"{group}/DCMD/{node}/{starter}", "Sparkplug's device commands"
    for topic in ("status", "fresh") if is_real else (PROBE,):
        yield f"{base}/gateway/{topic}", "what the gateway says of itself"
    if is_real:
        return
    yield f"{base}/starter/{PROBE}/event", "events of a starter"
    yield f"{base}/audit", "the audit"
    yield from ((f"{base}/result/{PROBE}/{client}", f"results for {client}") for client in _clients(config))
    yield from ((f"{base}/command/{PROBE}/{PROBE}/{verb}", "commands of somebody unknown") for verb in VERBS)
    yield f"{base}/{PROBE}", "what no one publishes"
    yield f"{PROBE}/{PROBE}", "what is outside the base"
    if home is not None:
        yield f"{home.discovery_prefix}/device/{PROBE}/config", "discovery by Home Assistant"
        yield home.birth_topic or f"{home.discovery_prefix}/status", "Home Assistant's birth"
    if spb is not None:
        yield f"{group}/DDATA/{node}/{PROBE}", "Sparkplug's device data"
        yield f"{group}/NCMD/{node}", "Sparkplug's node commands"
        yield f"{group}/DDATA/{PROBE}/{PROBE}", "Sparkplug's data of another node"
        if spb.primary_host is not None:
            yield state_topic(spb.primary_host), "the Sparkplug host's state"


def _clients(config: Config) -> tuple[str, ...]:
    return tuple(dict.fromkeys(each.client for each in config.operators))


def _takes(topic_filter: str, topic: str) -> bool:
    """Return whether a filter takes a topic."""
    pattern = re.escape(topic_filter).replace(r"\+", "[^/]+").replace(r"/\#", "(/.*)?")
    return re.fullmatch(pattern, topic) is not None
