"""Which topics who may write and read at the broker: one table for every configuration; pure.

The access list, the bridge's topics and what `--prove` expects all follow from it.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import get_args
from urllib.parse import urlsplit

from gateway.config.integration_tables import SparkplugTable
from gateway.config.schema import Config, Verb
from gateway.config.values import SCHEMES
from gateway.plugins.sparkplug.topics import NAMESPACE, state_topic

PROBE = "acl-probe"  # a starter, and an operator, that does not exist, for the proof
VERBS = tuple(verb for verb in get_args(Verb) if verb != "*")

# Writers and readers by the letters of `_ROLES`: gateway, operator, viewer, auditor, Home Assistant,
# Sparkplug's node and host, the bridge up and down, prover.
_TABLE = """
when         filter                         writes reads  tried                                     what
-            {base}/starter/#               G      OVHU   {base}/starter/{probe}/state              what a starter does
-            {base}/starter/+/event         -      A      {base}/starter/{probe}/event              events of a starter
-            {base}/gateway/#               G      OVHU   {base}/gateway/{probe}                    what the gateway says of itself
-            {base}/gateway/event           -      A      -                                         -
-            {base}/audit                   G      AU     {base}/audit                              the audit
-            {base}/result/#                G      U      -                                         -
client       {base}/result/+/{client}       -      O      {base}/result/{probe}/{client}            results for {client}
client       {base}/command/+/{client}/#    O      -      {base}/command/{probe}/{client}/{verb}    commands of {client}
remote       {base}/command/+/{client}/+    D      -      -                                         -
-            -                              -      -      {base}/command/{probe}/{probe}/{verb}     commands of somebody unknown
-            {base}/#                       -      GP     {base}/{probe}                            what no one publishes
-            {probe}/#                      -      P      {probe}/{probe}                           what is outside the base
home         {prefix}/device/+/config       G      -      {prefix}/device/{probe}/config            discovery by Home Assistant
home         {prefix}/#                     -      HP     -                                         -
home         {birth}                        H      GHP    {birth}                                   Home Assistant's birth
bridged      {prefix}/device/+/config       -      U      -                                         -
bridged      {birth}                        D      -      -                                         -
spb          {group}/NBIRTH/{node}          N      U      -                                         -
spb          {group}/NDATA/{node}           N      U      -                                         -
spb          {group}/NDEATH/{node}          N      U      -                                         -
spb          {group}/DBIRTH/{node}/+        N      U      -                                         -
spb          {group}/DDATA/{node}/+         N      U      {group}/DDATA/{node}/{probe}              Sparkplug's device data
spb          {group}/DDEATH/{node}/+        N      U      -                                         -
spb          {group}/NCMD/{node}            SD     N      {group}/NCMD/{node}                       Sparkplug's node commands
dcmd         {group}/DCMD/{node}/+          S      N      -                                         -
dcmd_remote  {group}/DCMD/{node}/+          D      -      -                                         -
spb          -                              -      -      {group}/DCMD/{node}/{probe}               Sparkplug's device commands
spb          {group}/#                      -      S      {group}/DDATA/{probe}/{probe}             Sparkplug's data of another node
spb          spBv1.0/#                      -      P      -                                         -
spb_state    {state}                        S      NS     {state}                                   the Sparkplug host's state
real         -                              -      -      {base}/gateway/status                     what the gateway says of itself
real         -                              -      -      {base}/gateway/fresh                      what the gateway says of itself
real         -                              -      -      {base}/starter/{starter}/state            what a starter does
real_client  -                              -      -      {base}/command/{starter}/{client}/start   commands of {client}
real_spb     -                              -      -      {group}/DCMD/{node}/{starter}             Sparkplug's device commands
"""  # noqa: E501 - a table


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


@dataclass(frozen=True, slots=True)
class Row:
    """One row of the table: who writes to a filter of topics, and who reads there; of `client` alone."""

    filter: str  # empty: no login may use these topics
    writes: frozenset[Role]
    reads: frozenset[Role]
    tried: str  # a topic that the proof tries
    what: str  # is published there
    client: str = ""
    is_real: bool = False  # `tried` is the topic of something that exists


def table_of(config: Config, central_base: str) -> Iterator[Row]:
    """Yield who may write and read what; `central_base` is empty without a bridge."""
    cases = _cases(config, central_base)
    for line in _TABLE.strip().splitlines()[1:]:
        when, *cells = re.split(" {2,}", line)
        for values in cases[when]:
            for verb in VERBS if "{verb}" in line else ("",):
                said = ("" if cell == "-" else cell.format_map({**values, "verb": verb}) for cell in cells)
                topics, writes, reads, tried, what = said
                by, to = (frozenset(_ROLES[letter] for letter in letters) for letters in (writes, reads))
                yield Row(topics, by, to, tried, what, values["client"], when.startswith("real"))


def _cases(config: Config, central_base: str) -> dict[str, list[dict[str, str]]]:
    """Return for which words the rows of each kind stand."""
    home, spb, remote = config.home_assistant, sparkplug_here(config), remote_clients(config)
    all_ = {"base": config.base, "probe": PROBE, "client": ""}
    clients = [{**all_, "client": each} for each in dict.fromkeys(each.client for each in config.operators)]
    real = [{"starter": each.name} for each in config.starters]
    cases: dict[str, list[dict[str, str]]] = defaultdict(list)
    cases |= {"-": [all_], "client": clients, "real": [all_ | each for each in real]}
    cases["remote"] = [each for each in clients if each["client"] in remote]
    cases["real_client"] = [one | other for one in clients for other in real]
    if home is not None:
        birth = home.birth_topic or f"{home.discovery_prefix}/status"
        cases["home"] = [{**all_, "prefix": home.discovery_prefix, "birth": birth}]
        # Discovery names the topics of the edge: they must be the same at the central broker.
        cases["bridged"] = cases["home"] if central_base == config.base else []
    if spb is not None:
        node = {**all_, "group": f"{NAMESPACE}/{spb.group}", "node": spb.node or config.gateway.name}
        state = "" if spb.primary_host is None else state_topic(spb.primary_host)
        cases |= {"spb": [node], "real_spb": [node | each for each in real]}
        cases["dcmd"] = [node] if spb.commands else []
        cases["dcmd_remote"] = cases["dcmd"] if spb.operator in remote else []
        cases["spb_state"] = [{**node, "state": state}] if state else []
    return cases


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
    settings: dict[str, set[str]] = {}
    for each in config.operators:
        settings.setdefault(each.client, set()).add(each.freshness)
    return tuple(client for client, freshness in settings.items() if freshness == {"issued_at"})
