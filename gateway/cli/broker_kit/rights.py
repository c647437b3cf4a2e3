"""Who logs in at the broker, and which topics each may read and write: one table for every configuration.

The access list, the bridge's topics and what `--prove` expects all follow from it.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import get_args
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict

from gateway.cli.broker_kit.lint import overlap
from gateway.config.integration_tables import SparkplugTable
from gateway.config.schema import Config, Verb
from gateway.config.values import SCHEMES
from gateway.errors import ConfigError, Problem, UsageError
from gateway.plugins.sparkplug.topics import NAMESPACE, state_topic

PROVER = "prover"  # reads everything, for the proof
PROBE = "acl-probe"  # a starter, and an operator, that does not exist, for the proof
VERBS = tuple(verb for verb in get_args(Verb) if verb != "*")
BRIDGE_UP, BRIDGE_DOWN = "bridge-up", "bridge-down"

_NAME = re.compile(r"(?!\.+$)[A-Za-z0-9_.@-]{1,64}")  # also the name of a file
_HOME_ASSISTANT, _SPARKPLUG_HOST = "home-assistant", "sparkplug-host"  # where no [[operator]] is named


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


class KitSettings(BaseModel):
    """What a kit is made of beside the configuration; stored in it, for updates and the proof."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    hosts: tuple[str, ...] = ()
    viewers: tuple[str, ...] = ("viewer",)
    auditors: tuple[str, ...] = ("auditor",)
    further: dict[str, str] = {}  # login: operator; like viewers and auditors named in no table
    bridge: str = ""  # host[:port] of the central broker
    bridge_base: str = ""  # of this gateway's topics there
    has_bridge_ca: bool = False

    def central_base(self, config: Config) -> str:
        """Return the base of this gateway's topics at the central broker; empty without a bridge."""
        base = (self.bridge_base or config.base).replace("{gateway}", config.gateway.name)
        return base if self.bridge else ""


@dataclass(slots=True)
class Login:
    """One login, which has one connection at a time."""

    name: str
    client: str = ""  # of an [[operator]]: its level in command and result topics
    roles: set[Role] = field(default_factory=set)
    reads: list[str] = field(default_factory=list)  # topic filters
    writes: list[str] = field(default_factory=list)


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

    def is_for(self, login: Login, roles: frozenset[Role]) -> bool:
        """Return whether a login is among its writers or readers."""
        is_another = self.client not in ("", login.client)
        return not (login.roles - ({Role.OPERATOR} if is_another else set())).isdisjoint(roles)


@dataclass(frozen=True, slots=True)
class TriedTopic:
    """One topic to try; all logins but its writers and readers must be refused."""

    name: str
    what: str  # is published there
    writers: frozenset[str]  # logins
    readers: frozenset[str]
    is_real: bool = False  # the topic of something that exists: who may write there does not try it


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


def table_of(config: Config, settings: KitSettings) -> Iterator[Row]:
    """Yield who may write and read what, in this configuration."""
    cases = _cases(config, settings)
    for line in _TABLE.strip().splitlines()[1:]:
        when, *cells = re.split(" {2,}", line)
        for values in cases[when]:
            for verb in VERBS if "{verb}" in line else ("",):
                said = ("" if cell == "-" else cell.format_map({**values, "verb": verb}) for cell in cells)
                topics, writes, reads, tried, what = said
                by, to = (frozenset(_ROLES[letter] for letter in letters) for letters in (writes, reads))
                yield Row(topics, by, to, tried, what, values["client"], when.startswith("real"))


def _cases(config: Config, settings: KitSettings) -> dict[str, list[dict[str, str]]]:
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
        cases["bridged"] = cases["home"] if settings.central_base(config) == config.base else []
    if spb is not None:
        node = {**all_, "group": f"{NAMESPACE}/{spb.group}", "node": spb.node or config.gateway.name}
        state = "" if spb.primary_host is None else state_topic(spb.primary_host)
        cases |= {"spb": [node], "real_spb": [node | each for each in real]}
        cases["dcmd"] = [node] if spb.commands else []
        cases["dcmd_remote"] = cases["dcmd"] if spb.operator in remote else []
        cases["spb_state"] = [{**node, "state": state}] if state else []
    return cases


def logins_of(config: Config, settings: KitSettings) -> tuple[Login, ...]:
    """Return every login with its rights; ConfigError or UsageError when two would have one name."""
    found: dict[str, Login] = {}
    for login in _named(config, settings):
        if not _NAME.fullmatch(login.name):
            raise UsageError(f"{login.name!r} is no name for a login (a-z, 0-9, _ . @ and -)")
        if PROBE in (login.name, login.client) or (login.name in found and login.name == PROVER):
            raise UsageError(f"the name {login.name} is the proof's own (choose another)")
        if login.name in found:
            raise UsageError(f"two logins have the name {login.name} (each needs one of its own)")
        found[login.name] = login
    if (home := config.home_assistant) is not None:
        name = home.operator or _HOME_ASSISTANT
        found.setdefault(name, Login(name)).roles.add(Role.HOME_ASSISTANT)
    if (spb := sparkplug_here(config)) is not None:
        name = spb.operator or _SPARKPLUG_HOST
        found.setdefault(name, Login(name)).roles.add(Role.SPARKPLUG_HOST)
    rows = tuple(table_of(config, settings))
    for login in found.values():
        login.reads = [row.filter for row in rows if row.filter and row.is_for(login, row.reads)]
        login.writes = [row.filter for row in rows if row.filter and row.is_for(login, row.writes)]
    is_idle = [login.name for login in found.values() if Role.BRIDGE_DOWN in login.roles and not login.writes]
    return tuple(login for login in found.values() if login.name not in is_idle)


def _named(config: Config, settings: KitSettings) -> Iterator[Login]:
    clients = dict.fromkeys(each.client for each in config.operators)
    yield Login(gateway_login(config), "", {Role.GATEWAY})
    for name, client in settings.further.items():
        if client not in clients:
            raise UsageError(f"--login {name}={client}: there is no [[operator]] {client}")
    for name, client in [*((each, each) for each in clients), *settings.further.items()]:
        yield Login(name, client, {Role.OPERATOR})
    guests = [(Role.VIEWER, settings.viewers), (Role.AUDITOR, settings.auditors)]
    guests += [(Role.BRIDGE_UP, (BRIDGE_UP,)), (Role.BRIDGE_DOWN, (BRIDGE_DOWN,))] if settings.bridge else []
    for role, names in (*guests, (Role.PROVER, (PROVER,))):
        yield from (Login(name, "", {role}) for name in names)
    table = sparkplug_here(config)
    if table is not None:
        node = table.username
        if node is None or node in (gateway_login(config), *clients) or not _NAME.fullmatch(node):
            what = "the node needs a login of its own: at this broker a login has one connection at a time"
            own = f'username = "{config.gateway.name}-spb", password_file, ca_file'
            hint = f'urls = ["{config.mqtt.url}"], {own}'
            raise ConfigError("broker-kit", [Problem("sparkplug.username", what, hint)])
        yield Login(node, "", {Role.SPARKPLUG_NODE})


def gateway_login(config: Config) -> str:
    """Return the gateway's login; ConfigError when it has none that a broker could tie to topics."""
    name = config.mqtt.username
    if name is None or not _NAME.fullmatch(name):
        what = (
            "is missing: the broker ties topics to it" if name is None else f"{name!r} is no name for a login"
        )
        hint = f'username = "{config.gateway.name}" and password_file = "mqtt.password"'
        raise ConfigError("broker-kit", [Problem("mqtt.username", what, hint)])
    return name


def tried_topics(config: Config, settings: KitSettings, logins: Sequence[Login]) -> tuple[TriedTopic, ...]:
    """Return the topics that the proof tries; of what exists only for those who must be refused.

    A list may have a line for one real starter alone.
    """
    rows = {row.tried: row for row in reversed(list(table_of(config, settings))) if row.tried}
    return tuple(
        TriedTopic(
            topic,
            row.what,
            frozenset(each.name for each in logins if any(overlap(one, topic) for one in each.writes)),
            frozenset(each.name for each in logins if any(overlap(one, topic) for one in each.reads)),
            row.is_real,
        )
        for topic, row in reversed(rows.items())
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
    settings: dict[str, set[str]] = {}
    for each in config.operators:
        settings.setdefault(each.client, set()).add(each.freshness)
    return tuple(client for client, freshness in settings.items() if freshness == {"issued_at"})


def access_list(logins: Iterable[Login]) -> str:
    """Return Mosquitto's access list; a block for each login, since what has none may do nothing."""
    return "\n".join([_HEAD, *("\n".join(_block(login)) for login in logins)])


_HEAD = """\
# Who may do what at the broker; written by `starter-gateway broker-kit`, from [[operator]] and mqtt.base.
#
# The gateway trusts the client's name in a command's topic because of this file: each login writes commands
# only under its own name. One block for each, on purpose: a `pattern write` would also let those write who
# should only look on. Logins without a block may do nothing.
"""


def _block(login: Login) -> Iterator[str]:
    yield f"# {', '.join(sorted(login.roles))}"
    yield f"user {login.name}"
    yield from (f"topic read {each}" for each in login.reads)
    yield from (f"topic write {each}" for each in login.writes)
    yield ""
