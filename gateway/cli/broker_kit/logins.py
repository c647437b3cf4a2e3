"""Who logs in at the broker, and which topics each may read and write; made from the configuration."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict

from gateway.config.integration_tables import SparkplugTable
from gateway.config.schema import Config
from gateway.config.values import SCHEMES
from gateway.errors import ConfigError, Problem, UsageError
from gateway.plugins.sparkplug.topics import NAMESPACE, EdgeTopics, state_topic

PROVER = "prover"  # reads everything, for the proof
PROBE = "acl-probe"  # a starter, and an operator, that does not exist, for the proof
ISSUED_AT = "issued_at"

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


@dataclass(slots=True)
class Login:
    """One login, which has one connection at a time."""

    name: str
    client: str = ""  # of an [[operator]]: its level in command and result topics
    roles: set[Role] = field(default_factory=set)
    reads: list[str] = field(default_factory=list)  # topic filters
    writes: list[str] = field(default_factory=list)


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


def logins_of(config: Config, settings: KitSettings) -> tuple[Login, ...]:
    """Return every login with its rights; ConfigError or UsageError when two would have one name."""
    found: dict[str, Login] = {}
    for login in (_gateway(config), *_operators(config, settings), *_guests(config, settings)):
        if not _NAME.fullmatch(login.name):
            raise UsageError(f"{login.name!r} is no name for a login (a-z, 0-9, _ . @ and -)")
        if PROBE in (login.name, login.client):
            raise UsageError(f"the name {PROBE} is the proof's own (choose another)")
        if login.name in found:
            raise UsageError(f"two logins have the name {login.name} (each needs one of its own)")
        found[login.name] = login
    _add_home_assistant(config, found)
    _add_sparkplug(config, found)
    _add_prover(config, found)
    return tuple(found.values())


def sparkplug_here(config: Config) -> SparkplugTable | None:
    """Return the table of Sparkplug when this broker is (one of) its servers."""
    table = config.sparkplug
    if table is None or not table.urls:
        return table
    here = config.mqtt.host, config.mqtt.port
    ends = [(parts.hostname, parts.port or SCHEMES[parts.scheme]) for parts in map(urlsplit, table.urls)]
    return table if here in ends else None


def birth_topic(config: Config) -> str:
    """Return where Home Assistant says that it has begun; empty without Home Assistant."""
    table = config.home_assistant
    return "" if table is None else table.birth_topic or f"{table.discovery_prefix}/status"


def edge_topics(config: Config, table: SparkplugTable) -> EdgeTopics:
    """Return the gateway's topics as a Sparkplug node."""
    return EdgeTopics(table.group, table.node or config.gateway.name)


def remote_clients(config: Config) -> tuple[str, ...]:
    """Return the operators whose commands may pass a bridge: those of `freshness = "issued_at"` alone."""
    settings: dict[str, set[str]] = {}
    for each in config.operators:
        settings.setdefault(each.client, set()).add(each.freshness)
    return tuple(client for client, freshness in settings.items() if freshness == {ISSUED_AT})


def access_list(logins: tuple[Login, ...]) -> str:
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


def _gateway(config: Config) -> Login:
    base = config.base
    writes = [f"{base}/gateway/#", f"{base}/starter/#", f"{base}/result/#", f"{base}/audit"]
    return Login(gateway_login(config), "", {Role.GATEWAY}, [f"{base}/#"], writes)


def _operators(config: Config, settings: KitSettings) -> Iterator[Login]:
    clients = dict.fromkeys(each.client for each in config.operators)
    for name, client in settings.further.items():
        if client not in clients:
            raise UsageError(f"--login {name}={client}: there is no [[operator]] {client}")
    for name, client in [*((each, each) for each in clients), *settings.further.items()]:
        reads = [*_seen_by_all(config), f"{config.base}/result/+/{client}"]
        yield Login(name, client, {Role.OPERATOR}, reads, [f"{config.base}/command/+/{client}/#"])


def _guests(config: Config, settings: KitSettings) -> Iterator[Login]:
    base = config.base
    for name in settings.viewers:
        yield Login(name, "", {Role.VIEWER}, _seen_by_all(config))
    for name in settings.auditors:
        books = [f"{base}/gateway/event", f"{base}/starter/+/event", f"{base}/audit"]
        yield Login(name, "", {Role.AUDITOR}, books)


def _add_home_assistant(config: Config, logins: dict[str, Login]) -> None:
    table = config.home_assistant
    if table is None:
        return
    gateway = logins[gateway_login(config)]
    gateway.reads.append(birth_topic(config))
    gateway.writes.append(f"{table.discovery_prefix}/device/+/config")
    name = table.operator or _HOME_ASSISTANT
    login = logins.setdefault(name, Login(name, "", set(), [] if table.operator else _seen_by_all(config)))
    login.roles.add(Role.HOME_ASSISTANT)
    login.reads += [f"{table.discovery_prefix}/#", birth_topic(config)]
    login.writes.append(birth_topic(config))


def _add_sparkplug(config: Config, logins: dict[str, Login]) -> None:
    table = sparkplug_here(config)
    if table is None:
        return
    edge, name = edge_topics(config, table), table.username
    if name is None or name in logins or not _NAME.fullmatch(name):
        what = "the node needs a login of its own: at this broker a login has one connection at a time"
        hint = f'urls = ["{config.mqtt.url}"], username = "{config.gateway.name}-spb", password_file, ca_file'
        raise ConfigError("broker-kit", [Problem("sparkplug.username", what, hint)])
    states = [] if table.primary_host is None else [state_topic(table.primary_host)]
    born = [edge.of(kind) for kind in ("NBIRTH", "NDATA", "NDEATH")]
    born += [f"{edge.of(kind)}/+" for kind in ("DBIRTH", "DDATA", "DDEATH")]
    commands = [edge.node_command, *([edge.device_commands] if table.commands else [])]
    logins[name] = Login(name, "", {Role.SPARKPLUG_NODE}, [*commands, *states], born)
    host = table.operator or _SPARKPLUG_HOST
    login = logins.setdefault(host, Login(host))
    login.roles.add(Role.SPARKPLUG_HOST)
    login.reads += [f"{NAMESPACE}/{table.group}/#", *states]
    login.writes += [*commands, *states]


def _add_prover(config: Config, logins: dict[str, Login]) -> None:
    if PROVER in logins:
        raise UsageError(f"the login {PROVER} is the proof's own (choose another name)")
    reads = [f"{config.base}/#"]
    if config.home_assistant is not None:
        reads += [f"{config.home_assistant.discovery_prefix}/#", birth_topic(config)]
    if sparkplug_here(config) is not None:
        reads.append(f"{NAMESPACE}/#")
    logins[PROVER] = Login(PROVER, "", {Role.PROVER}, [*reads, f"{PROBE}/#"])


def _seen_by_all(config: Config) -> list[str]:
    return [f"{config.base}/gateway/#", f"{config.base}/starter/#"]
