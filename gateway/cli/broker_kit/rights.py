"""Who may write and read which topics at the broker: one table for every configuration; pure.

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

# `when` names the case in which a row counts (`_cases`); writers and readers are letters of `_ROLES`.
# {B} is the base, {P} the probe, {C} a client, {V} a verb, {X} a starter; of Home Assistant {H} the prefix,
# {A} the birth; of Sparkplug {S} the group, {N} the node, {T} the state of the primary host.
_TABLE = """
when         filter               writes  reads  tried                      what
-            {B}/starter/#        G       OVHU   {B}/starter/{P}/state      what a starter does
-            {B}/starter/+/event  -       A      {B}/starter/{P}/event      events of a starter
-            {B}/gateway/#        G       OVHU   {B}/gateway/{P}            what the gateway says of itself
-            {B}/gateway/event    -       A      -                          -
-            {B}/audit            G       AU     {B}/audit                  the audit
-            {B}/result/#         G       U      -                          -
client       {B}/result/+/{C}     -       O      {B}/result/{P}/{C}         results for {C}
client       {B}/command/+/{C}/#  O       -      {B}/command/{P}/{C}/{V}    commands of {C}
remote       {B}/command/+/{C}/+  D       -      -                          -
-            -                    -       -      {B}/command/{P}/{P}/{V}    commands of somebody unknown
-            {B}/#                -       GP     {B}/{P}                    what no one publishes
-            {P}/#                -       P      {P}/{P}                    what is outside the base
home         {H}/device/+/config  G       -      {H}/device/{P}/config      discovery by Home Assistant
home         {H}/#                -       HP     -                          -
home         {A}                  H       GHP    {A}                        Home Assistant's birth
bridged      {H}/device/+/config  -       U      -                          -
bridged      {A}                  D       -      -                          -
spb          {S}/NBIRTH/{N}       N       U      -                          -
spb          {S}/NDATA/{N}        N       U      -                          -
spb          {S}/NDEATH/{N}       N       U      -                          -
spb          {S}/DBIRTH/{N}/+     N       U      -                          -
spb          {S}/DDATA/{N}/+      N       U      {S}/DDATA/{N}/{P}          Sparkplug's device data
spb          {S}/DDEATH/{N}/+     N       U      -                          -
spb          {S}/NCMD/{N}         SD      N      {S}/NCMD/{N}               Sparkplug's node commands
dcmd         {S}/DCMD/{N}/+       S       N      -                          -
dcmd_remote  {S}/DCMD/{N}/+       D       -      -                          -
spb          -                    -       -      {S}/DCMD/{N}/{P}           Sparkplug's device commands
spb          {S}/#                -       S      {S}/DDATA/{P}/{P}          Sparkplug's data of another node
spb          spBv1.0/#            -       P      -                          -
spb_state    {T}                  S       NS     {T}                        the Sparkplug host's state
real         -                    -       -      {B}/gateway/status         what the gateway says of itself
real         -                    -       -      {B}/gateway/fresh          what the gateway says of itself
real         -                    -       -      {B}/starter/{X}/state      what a starter does
real_client  -                    -       -      {B}/command/{X}/{C}/start  commands of {C}
real_spb     -                    -       -      {S}/DCMD/{N}/{X}           Sparkplug's device commands
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


_ROLES = dict(zip("GOVAHNSUDP", Role, strict=True))  # P the prover, U and D the bridge up and down


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
            for verb in VERBS if "{V}" in line else ("",):
                said = ("" if cell == "-" else cell.format_map({**values, "V": verb}) for cell in cells)
                topics, writes, reads, tried, what = said
                by, to = (frozenset(_ROLES[letter] for letter in letters) for letters in (writes, reads))
                yield Row(topics, by, to, tried, what, values["C"], when.startswith("real"))


def _cases(config: Config, central_base: str) -> dict[str, list[dict[str, str]]]:
    """Return for which words the rows of each kind stand."""
    home, spb, remote = config.home_assistant, sparkplug_here(config), remote_clients(config)
    all_ = {"B": config.base, "P": PROBE, "C": ""}
    clients = [{**all_, "C": each} for each in dict.fromkeys(each.client for each in config.operators)]
    real = [{"X": each.name} for each in config.starters]
    cases: dict[str, list[dict[str, str]]] = defaultdict(list)
    cases |= {"-": [all_], "client": clients, "real": [all_ | each for each in real]}
    cases["remote"] = [each for each in clients if each["C"] in remote]
    cases["real_client"] = [one | other for one in clients for other in real]
    if home is not None:
        birth = home.birth_topic or f"{home.discovery_prefix}/status"
        cases["home"] = [{**all_, "H": home.discovery_prefix, "A": birth}]
        # Discovery names the topics of the edge: they must be the same at the central broker.
        cases["bridged"] = cases["home"] if central_base == config.base else []
    if spb is not None:
        node = {**all_, "S": f"{NAMESPACE}/{spb.group}", "N": spb.node or config.gateway.name}
        state = "" if spb.primary_host is None else state_topic(spb.primary_host)
        cases |= {"spb": [node], "real_spb": [node | each for each in real]}
        cases["dcmd"] = [node] if spb.commands else []
        cases["dcmd_remote"] = cases["dcmd"] if spb.operator in remote else []
        cases["spb_state"] = [{**node, "T": state}] if state else []
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
