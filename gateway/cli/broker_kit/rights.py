"""Who may write and read which topics at the broker: one table for every configuration; pure.

The access list, the bridge's topics and what `--prove` expects all follow from it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import product
from typing import get_args
from urllib.parse import urlsplit

from gateway.config import SCHEMES, Config, SparkplugTable, Verb
from gateway.plugins.sparkplug.settings import NAMESPACE, state_topic

PROBE = "acl-probe"  # a starter, and an operator, that does not exist, for the proof
VERBS = tuple(verb for verb in get_args(Verb) if verb != "*")

# A row counts for each of the words that it names, and not at all where there is no such word (`_words`):
# {B} the base, {P} the probe, {C} a client, {R} one whose commands may pass a bridge, {V} a verb, {X} a
# starter; {H} Home Assistant's prefix, {A} its birth, {I} and {J} the same where they pass the bridge; {K}
# Sparkplug's namespace, {S} its group, {N} its node, {D} its device commands, {E} those that pass the bridge,
# {T} its host.
# Writers and readers are letters of `_ROLES`.
_RIGHTS = """
{B}/starter/#        G   OVHU
{B}/starter/+/event  -   A
{B}/gateway/#        G   OVHU
{B}/gateway/event    -   A
{B}/audit            G   AU
{B}/result/#         G   U
{B}/result/+/{C}     -   O
{B}/command/+/{C}/#  O   -
{B}/command/+/{R}/+  D   -
{B}/#                -   GP
{P}/#                -   P
{H}/device/+/config  G   -
{H}/#                -   HP
{A}                  H   GHP
{I}/device/+/config  -   U
{J}                  D   -
{S}/NBIRTH/{N}       N   U
{S}/NDATA/{N}        N   U
{S}/NDEATH/{N}       N   U
{S}/DBIRTH/{N}/+     N   U
{S}/DDATA/{N}/+      N   U
{S}/DDEATH/{N}/+     N   U
{S}/NCMD/{N}         SD  N
{D}/+                S   N
{E}/+                D   -
{S}/#                -   S
{K}/#                -   P
{T}                  S   NS
"""
_TRIED = """
{B}/starter/{P}/state      what a starter does
{B}/starter/{P}/event      events of a starter
{B}/gateway/{P}            what the gateway says of itself
{B}/audit                  the audit
{B}/result/{P}/{C}         results for {C}
{B}/command/{P}/{C}/{V}    commands of {C}
{B}/command/{P}/{P}/{V}    commands of somebody unknown
{B}/{P}                    what no one publishes
{P}/{P}                    what is outside the base
{H}/device/{P}/config      discovery by Home Assistant
{A}                        Home Assistant's birth
{S}/DDATA/{N}/{P}          Sparkplug's device data
{S}/NCMD/{N}               Sparkplug's node commands
{S}/DCMD/{N}/{P}           Sparkplug's device commands
{S}/DDATA/{P}/{P}          Sparkplug's data of another node
{T}                        the Sparkplug host's state
"""
_REAL = """
{B}/gateway/status         what the gateway says of itself
{B}/gateway/fresh          what the gateway says of itself
{B}/starter/{X}/state      what a starter does
{B}/command/{X}/{C}/start  commands of {C}
{S}/DCMD/{N}/{X}           Sparkplug's device commands
"""


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
    writers: frozenset[str]  # logins
    readers: frozenset[str]
    is_real: bool  # the topic of something that exists: who may write there does not try it


def give_rights(logins: Iterable[Login], config: Config, central_base: str) -> None:
    """Give each login the filters of its roles; `central_base` is empty without a bridge."""
    words = _words(config, central_base)
    for cells, names in _filled(_RIGHTS, words):
        for login in logins:
            others = {Role.OPERATOR} if names.get("C", login.client) != login.client else set()
            for letters, filters in ((cells[1], login.writes), (cells[2], login.reads)):
                if {_ROLES.get(letter) for letter in letters} & (login.roles - others):
                    filters.append(cells[0])


def tried_topics(config: Config, logins: Sequence[Login]) -> tuple[TriedTopic, ...]:
    """Return the topics that the proof tries; of what exists only for those who must be refused.

    A list may have a line for one real starter alone.
    """
    words, found = _words(config, ""), dict[str, TriedTopic]()
    for table in (_TRIED, _REAL):
        for (topic, what), _ in _filled(table, words):
            writers, readers = (
                frozenset(
                    login.name for login in logins if any(_takes(each, topic) for each in getattr(login, key))
                )
                for key in ("writes", "reads")
            )
            found.setdefault(topic, TriedTopic(topic, what, writers, readers, table is _REAL))
    return tuple(found.values())


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


def _words(config: Config, central_base: str) -> dict[str, Sequence[str]]:
    """Return the words that the rows name."""
    home, spb, remote = config.home_assistant, sparkplug_here(config), remote_clients(config)
    words: dict[str, Sequence[str]] = dict.fromkeys("HAIJKSNDET", ())
    words |= {"B": [config.base], "P": [PROBE], "R": remote, "V": VERBS}
    words["C"] = list(dict.fromkeys(each.client for each in config.operators))
    words["X"] = [each.name for each in config.starters]
    if home is not None:
        words |= {"H": [home.discovery_prefix], "A": [home.birth_topic or f"{home.discovery_prefix}/status"]}
        if central_base == config.base:  # discovery names the edge's topics, which must be the same there
            words |= {"I": words["H"], "J": words["A"]}
    if spb is not None:
        group, node = f"{NAMESPACE}/{spb.group}", spb.node or config.gateway.name
        words |= {
            "K": [NAMESPACE],
            "S": [group],
            "N": [node],
            "D": [f"{group}/DCMD/{node}"] if spb.commands else [],
        }
        words["E"] = words["D"] if spb.operator in remote else []
        words["T"] = [] if spb.primary_host is None else [state_topic(spb.primary_host)]
    return words


def _filled(table: str, words: Mapping[str, Sequence[str]]) -> Iterator[tuple[list[str], Mapping[str, str]]]:
    """Yield the cells of each row, once for each combination of the words that it names, and these."""
    for row in table.strip().splitlines():
        names = sorted(set(re.findall(r"{(.)}", row)))
        for values in product(*(words[name] for name in names)):
            said = dict(zip(names, values, strict=True))
            yield [cell.format_map(said) for cell in re.split(" {2,}", row)], said


def _takes(topic_filter: str, topic: str) -> bool:
    """Return whether a filter takes a topic."""
    pattern = re.escape(topic_filter).replace(r"\+", "[^/]+").replace(r"/\#", "(/.*)?")
    return re.fullmatch(pattern, topic) is not None
