"""Who may write and read which topics at the broker, for every configuration; pure.

The access lists of both brokers, the bridge's topics and the expectations of `--prove` all follow from
`_rights`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple, get_args
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
    password: str = ""  # which a kit knows


class Right(NamedTuple):
    """A filter, the letters in `_ROLES` of those who may use it, and what the proof tries of it."""

    topics: str
    writers: str = ""
    readers: str = ""
    what: str = ""  # is published there; empty: nothing is tried
    client: str = ""  # the one operator that O means
    end: str = PROBE  # of the tried topic, in place of #
    real: Sequence[str] = ()  # what exists, in place of the probe: who may write there does not try it


@dataclass(frozen=True, slots=True)
class TriedTopic:
    """One topic to try; all logins but its writers and readers must be refused."""

    name: str
    what: str  # is published there
    triers: frozenset[str]  # logins, as all others here
    writers: frozenset[str]
    readers: frozenset[str]


def give_rights(logins: Iterable[Login], config: Config, *, base: str, central_base: str) -> None:
    """Give each login the filters of its roles, at a broker with this base; the other may be empty."""
    for right in _rights(config, base, is_passing=central_base == config.base):
        for login in logins:
            others = {Role.OPERATOR} if right.client and right.client != login.client else set()
            for letters, filters in ((right.writers, login.writes), (right.readers, login.reads)):
                if {_ROLES[letter] for letter in letters} & (login.roles - others):
                    filters.append(right.topics)


def tried_topics(config: Config, logins: Sequence[Login]) -> tuple[TriedTopic, ...]:
    """Return the topics that the proof tries.

    A list may have a line for one real starter alone, or a pattern in which each login's own name counts.
    """
    found: dict[str, TriedTopic] = {}
    for right in _rights(config, config.base, is_passing=False):
        for name in (PROBE, *right.real) if right.what else ():
            topic = right.topics.replace("+", PROBE).replace("#", right.end).replace(PROBE, name, 1)
            writers, readers = (
                frozenset(login.name for login in logins if _may(getattr(login, key), topic))
                for key in ("writes", "reads")
            )
            triers = frozenset(login.name for login in logins) - (writers if name in right.real else set())
            found[topic] = TriedTopic(topic, right.what, triers, writers, readers)
    own = [
        TriedTopic(topic, tried.what, frozenset({login.name}), frozenset(), frozenset())
        for login in logins
        for tried in found.values()
        if not tried.name.startswith(PROBE)  # the prover reads no topic outside that begins with a login
        and (topic := tried.name.replace(PROBE, login.name)) not in found
        and not _may(login.writes, topic)
    ]
    return (*found.values(), *own)


def sparkplug_here(config: Config) -> SparkplugTable | None:
    """Return the table of Sparkplug when this broker is (one of) its servers."""
    table = config.sparkplug
    if table is None or not table.urls:
        return table
    here = config.mqtt.host, config.mqtt.port
    ends = [(parts.hostname, parts.port or SCHEMES[parts.scheme]) for parts in map(urlsplit, table.urls)]
    return table if here in ends else None


def clients_of(config: Config) -> tuple[str, ...]:
    """Return the operators' names, each once."""
    return tuple(dict.fromkeys(operator.client for operator in config.operators))


def remote_clients(config: Config) -> tuple[str, ...]:
    """Return the operators whose commands may pass a bridge: those of `freshness = "issued_at"` alone."""
    by_token = {operator.client for operator in config.operators if operator.freshness != "issued_at"}
    return tuple(client for client in clients_of(config) if client not in by_token)


def _rights(config: Config, base: str, *, is_passing: bool) -> Iterator[Right]:
    """Yield everybody's rights below a base, and below those of other programs.

    `is_passing`: discovery, which names the edge's topics, passes a bridge, since they are the same there.
    """
    clients, remote = clients_of(config), remote_clients(config)
    starters = [starter.name for starter in config.starters]
    what = "what a starter does"
    yield Right(f"{base}/starter/#", "G", "OVHU", what, end=f"{PROBE}/state", real=starters)
    yield Right(f"{base}/starter/+/event", "", "A", "events of a starter")
    what = "what the gateway says of itself"
    yield Right(f"{base}/gateway/#", "G", "OVHU", what, real=("status", "fresh"))
    yield Right(f"{base}/gateway/event", "", "A")
    yield Right(f"{base}/audit", "G", "AU", "the audit")
    yield Right(f"{base}/result/#", "G", "U")
    for client in (*clients, PROBE):
        who = client if client in clients else "somebody unknown"
        yield Right(f"{base}/result/+/{client}", "", "O", f"results for {who}", client)
        yield Right(f"{base}/command/+/{client}/#", "O", client=client)
        for verb in VERBS:
            real = starters if verb == "start" else ()
            yield Right(f"{base}/command/+/{client}/{verb}", what=f"commands of {who}", real=real)
    for client in remote:
        yield Right(f"{base}/command/+/{client}/+", "D")
    yield Right(f"{base}/#", "", "GP", "what no one publishes")
    yield Right(f"{PROBE}/#", "", "P", "what is outside the base")
    if (home := config.home_assistant) is not None:
        prefix, birth = home.discovery_prefix, home.birth_topic or f"{home.discovery_prefix}/status"
        passing = ("U", "HD") if is_passing else ("", "H")
        yield Right(f"{prefix}/device/+/config", "G", passing[0], "discovery by Home Assistant")
        yield Right(f"{prefix}/#", "", "HP")
        yield Right(birth, passing[1], "GHP", "Home Assistant's birth")
    if (spb := sparkplug_here(config)) is not None:
        group, node = f"{NAMESPACE}/{spb.group}", spb.node or config.gateway.name
        for kind in _OF_NODE:
            yield Right(f"{group}/{kind}/{node}", "N", "U")
        for kind in _OF_DEVICES:
            what = "Sparkplug's device data" if kind == "DDATA" else ""
            yield Right(f"{group}/{kind}/{node}/+", "N", "U", what)
        yield Right(f"{group}/NCMD/{node}", "SD", "N", "Sparkplug's node commands")
        writers = "" if not spb.commands else "SD" if spb.operator in remote else "S"
        what = "Sparkplug's device commands"
        yield Right(f"{group}/DCMD/{node}/+", writers, "N" if writers else "", what, real=starters)
        what = "Sparkplug's data of another node"
        yield Right(f"{group}/#", "", "S", what, end=f"DDATA/{PROBE}/{PROBE}")
        yield Right(f"{NAMESPACE}/#", "", "P")
        if spb.primary_host is not None:
            yield Right(state_topic(spb.primary_host), "S", "NS", "the Sparkplug host's state")


def _may(filters: Iterable[str], topic: str) -> bool:
    """Return whether one of some filters takes a topic."""
    patterns = (re.escape(rule).replace(r"\+", "[^/]+").replace(r"/\#", "(/.*)?") for rule in filters)
    return any(re.fullmatch(pattern, topic) for pattern in patterns)
