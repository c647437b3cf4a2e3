"""Which login may write and read which topic, by what the gateway trusts; not made from the access list."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import get_args

from gateway.cli.broker_kit.logins import (
    PROBE,
    Login,
    Role,
    birth_topic,
    edge_topics,
    remote_clients,
    sparkplug_here,
)
from gateway.config.schema import Config, Verb
from gateway.plugins.sparkplug.topics import NAMESPACE, state_topic

_VERBS = tuple(verb for verb in get_args(Verb) if verb != "*")
_ONLOOKERS = (Role.OPERATOR, Role.VIEWER, Role.HOME_ASSISTANT, Role.BRIDGE_UP)
_OURS = (Role.GATEWAY, Role.PROVER)
_BOOKS = (Role.GATEWAY, Role.AUDITOR, Role.PROVER, Role.BRIDGE_UP)


@dataclass(frozen=True, slots=True)
class TriedTopic:
    """One topic to try; all logins but its writers and readers must be refused."""

    name: str
    what: str  # is published there
    writers: frozenset[str]  # logins
    readers: frozenset[str]
    is_real: bool = False  # the topic of something that exists: who may write there does not try it


def topics_of(config: Config, logins: tuple[Login, ...]) -> tuple[TriedTopic, ...]:
    """Return the topics to try; of what exists only for those who must be refused."""
    own, home_assistant = _own(config, logins), _home_assistant(config, logins)
    return (*own, *home_assistant, *_sparkplug(config, logins), *_real(config, logins))


def _own(config: Config, logins: tuple[Login, ...]) -> Iterator[TriedTopic]:
    base = config.base
    gateway, books = _with(logins, Role.GATEWAY), _with(logins, *_BOOKS)
    onlookers = _with(logins, Role.GATEWAY, Role.PROVER, *_ONLOOKERS)
    yield TriedTopic(f"{base}/starter/{PROBE}/state", "what a starter does", gateway, onlookers)
    yield TriedTopic(f"{base}/starter/{PROBE}/event", "events of a starter", gateway, onlookers | books)
    yield TriedTopic(f"{base}/gateway/{PROBE}", "what the gateway says of itself", gateway, onlookers)
    yield TriedTopic(f"{base}/audit", "the audit", gateway, books)
    ours, up = _with(logins, *_OURS), _with(logins, Role.BRIDGE_UP)
    for client, writers in _commanders(config, logins).items():
        whose = frozenset(login.name for login in logins if login.client == client)
        yield TriedTopic(
            f"{base}/result/{PROBE}/{client}", f"results for {client}", gateway, ours | whose | up
        )
        for verb in _VERBS:
            topic = f"{base}/command/{PROBE}/{client}/{verb}"
            yield TriedTopic(topic, f"commands of {client}", writers, ours)
    none: frozenset[str] = frozenset()
    for verb in _VERBS:
        topic = f"{base}/command/{PROBE}/{PROBE}/{verb}"
        yield TriedTopic(topic, "commands of somebody unknown", none, ours)
    yield TriedTopic(f"{base}/{PROBE}", "what no one publishes", none, ours)
    yield TriedTopic(f"{PROBE}/{PROBE}", "what is outside the base", none, _with(logins, Role.PROVER))


def _real(config: Config, logins: tuple[Login, ...]) -> Iterator[TriedTopic]:
    """Yield topics of the gateway and its starters: a list may have a line for one of them alone."""
    base, gateway, ours = config.base, _with(logins, Role.GATEWAY), _with(logins, *_OURS)
    onlookers = ours | _with(logins, *_ONLOOKERS)
    for name in ("status", "fresh"):
        what = "what the gateway says of itself"
        yield TriedTopic(f"{base}/gateway/{name}", what, gateway, onlookers, is_real=True)
    for starter in (each.name for each in config.starters):
        state = f"{base}/starter/{starter}/state"
        yield TriedTopic(state, "what a starter does", gateway, onlookers, is_real=True)
        for client, writers in _commanders(config, logins).items():
            topic = f"{base}/command/{starter}/{client}/start"
            yield TriedTopic(topic, f"commands of {client}", writers, ours, is_real=True)
        table = sparkplug_here(config)
        if table is not None:
            seen = _with(logins, Role.SPARKPLUG_HOST, Role.SPARKPLUG_NODE, Role.PROVER)
            topic, writers = edge_topics(config, table).of("DCMD", starter), _commanding(config, logins)
            yield TriedTopic(topic, "Sparkplug's device commands", writers, seen, is_real=True)


def _commanders(config: Config, logins: tuple[Login, ...]) -> dict[str, frozenset[str]]:
    """Return by operator which logins may send its commands."""
    found: dict[str, frozenset[str]] = {}
    for client in dict.fromkeys(login.client for login in logins if login.client):
        whose = frozenset(login.name for login in logins if login.client == client)
        is_remote = client in remote_clients(config)
        found[client] = whose | _with(logins, Role.BRIDGE_DOWN) if is_remote else whose
    return found


def _home_assistant(config: Config, logins: tuple[Login, ...]) -> Iterator[TriedTopic]:
    table = config.home_assistant
    if table is None:
        return
    gateway, here = _with(logins, Role.GATEWAY), _with(logins, Role.HOME_ASSISTANT)
    prover, is_bridged = _with(logins, Role.PROVER), _passes(logins, birth_topic(config))
    up = _with(logins, Role.BRIDGE_UP) if is_bridged else frozenset[str]()
    down = _with(logins, Role.BRIDGE_DOWN) if is_bridged else frozenset[str]()
    discovery = f"{table.discovery_prefix}/device/{PROBE}/config"
    yield TriedTopic(discovery, "discovery by Home Assistant", gateway, here | prover | up)
    yield TriedTopic(birth_topic(config), "Home Assistant's birth", here | down, gateway | here | prover)


def _sparkplug(config: Config, logins: tuple[Login, ...]) -> Iterator[TriedTopic]:
    table = sparkplug_here(config)
    if table is None:
        return
    node, host = _with(logins, Role.SPARKPLUG_NODE), _with(logins, Role.SPARKPLUG_HOST)
    prover, edge = _with(logins, Role.PROVER), edge_topics(config, table)
    up, down = _with(logins, Role.BRIDGE_UP), _with(logins, Role.BRIDGE_DOWN)
    seen = host | prover
    yield TriedTopic(edge.of("DDATA", PROBE), "Sparkplug's device data", node, seen | up)
    yield TriedTopic(edge.node_command, "Sparkplug's node commands", host | down, node | seen)
    commanding = _commanding(config, logins)
    yield TriedTopic(edge.of("DCMD", PROBE), "Sparkplug's device commands", commanding, node | seen)
    another = f"{NAMESPACE}/{table.group}/DDATA/{PROBE}/{PROBE}"
    yield TriedTopic(another, "Sparkplug's data of another node", frozenset(), seen)
    if table.primary_host is not None:
        yield TriedTopic(state_topic(table.primary_host), "the Sparkplug host's state", host, node | seen)


def _commanding(config: Config, logins: tuple[Login, ...]) -> frozenset[str]:
    """Return who may send commands to Sparkplug's devices."""
    table = config.sparkplug
    if table is None or not table.commands:
        return frozenset()
    host, down = _with(logins, Role.SPARKPLUG_HOST), _with(logins, Role.BRIDGE_DOWN)
    return host | down if table.operator in remote_clients(config) else host


def _passes(logins: Iterable[Login], topic: str) -> bool:
    """Return whether a topic that only some bridges let in passes this one."""
    return any(topic in login.writes for login in logins if Role.BRIDGE_DOWN in login.roles)


def _with(logins: Iterable[Login], *roles: Role) -> frozenset[str]:
    return frozenset(login.name for login in logins if not login.roles.isdisjoint(roles))
