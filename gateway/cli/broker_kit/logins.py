"""Who logs in at the broker, with which rights, and the access list that says so to Mosquitto."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from pydantic import BaseModel, ConfigDict

from gateway.cli.broker_kit.lint import overlap
from gateway.cli.broker_kit.rights import PROBE, Role, Row, sparkplug_here, table_of
from gateway.config.schema import Config
from gateway.errors import ConfigError, Problem, UsageError

PROVER = "prover"  # reads everything, for the proof
BRIDGE_UP, BRIDGE_DOWN = "bridge-up", "bridge-down"

_NAME = re.compile(r"(?!\.+$)[A-Za-z0-9_.@-]{1,64}")  # also the name of a file
_HOME_ASSISTANT, _SPARKPLUG_HOST = "home-assistant", "sparkplug-host"  # where no [[operator]] is named
_HEAD = """\
# Who may do what at the broker; written by `starter-gateway broker-kit`, from [[operator]] and mqtt.base.
#
# The gateway trusts the client's name in a command's topic because of this file: each login writes commands
# only under its own name. One block for each, on purpose: a `pattern write` would also let those write who
# should only look on. Logins without a block may do nothing.
"""


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
class TriedTopic:
    """One topic to try; all logins but its writers and readers must be refused."""

    name: str
    what: str  # is published there
    writers: frozenset[str]  # logins
    readers: frozenset[str]
    is_real: bool = False  # the topic of something that exists: who may write there does not try it


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
    rows = tuple(table_of(config, settings.central_base(config)))
    for login in found.values():
        login.reads = [row.filter for row in rows if row.filter and _is_for(row, login, row.reads)]
        login.writes = [row.filter for row in rows if row.filter and _is_for(row, login, row.writes)]
    is_idle = [login.name for login in found.values() if Role.BRIDGE_DOWN in login.roles and not login.writes]
    return tuple(login for login in found.values() if login.name not in is_idle)


def _is_for(row: Row, login: Login, roles: frozenset[Role]) -> bool:
    """Return whether a login is among the writers or readers of a row, which may be one operator's alone."""
    others = {Role.OPERATOR} if row.client not in ("", login.client) else set()
    return not (login.roles - others).isdisjoint(roles)


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
    rows = {
        row.tried: row for row in reversed(list(table_of(config, settings.central_base(config)))) if row.tried
    }
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


def access_list(logins: Iterable[Login]) -> str:
    """Return Mosquitto's access list; a block for each login, since what has none may do nothing."""
    return "\n".join([_HEAD, *("\n".join(_block(login)) for login in logins)])


def _block(login: Login) -> Iterator[str]:
    yield f"# {', '.join(sorted(login.roles))}"
    yield f"user {login.name}"
    yield from (f"topic read {each}" for each in login.reads)
    yield from (f"topic write {each}" for each in login.writes)
    yield ""
