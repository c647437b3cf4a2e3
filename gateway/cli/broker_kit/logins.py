"""Who logs in at the broker, with which rights, and the access list that says so to Mosquitto."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from gateway.cli.broker_kit.rights import PROBE, Login, Role, give_rights, sparkplug_here
from gateway.cli.broker_kit.settings import LOGIN_NAME, KitSettings
from gateway.config import Config
from gateway.errors import ConfigError, Problem, UsageError

PROVER = "prover"  # reads everything, for the proof
BRIDGE_UP, BRIDGE_DOWN = "bridge-up", "bridge-down"

_HOME_ASSISTANT, _SPARKPLUG_HOST = "home-assistant", "sparkplug-host"  # where no [[operator]] is named
_HEAD = """\
# Who may do what at the broker; written by `starter-gateway broker-kit`, from [[operator]] and mqtt.base.
#
# The gateway trusts the client's name in a command's topic because of this file: each login writes commands
# only under its own name. One block for each, on purpose: a `pattern write` would also let those write who
# should only look on. Logins without a block may do nothing.
"""


def logins_of(config: Config, settings: KitSettings) -> tuple[Login, ...]:
    """Return every login with its rights; ConfigError or UsageError when two would have one name."""
    found: dict[str, Login] = {}
    for login in _named(config, settings):
        if login.name in found or PROBE in (login.name, login.client):
            raise UsageError(f"two logins have the name {login.name} (each needs one of its own)")
        found[login.name] = login
    home, spb = config.home_assistant, sparkplug_here(config)
    for table, name, role in (
        (home, _HOME_ASSISTANT, Role.HOME_ASSISTANT),
        (spb, _SPARKPLUG_HOST, Role.SPARKPLUG_HOST),
    ):
        if table is not None:
            name = table.operator or name
            found.setdefault(name, Login(name)).roles.add(role)
    give_rights(found.values(), config, settings.central_base(config))
    return tuple(login for login in found.values() if login.name != BRIDGE_DOWN or login.writes)


def gateway_login(config: Config) -> str:
    """Return the gateway's login; ConfigError when it has none that a broker could tie to topics."""
    name = config.mqtt.username
    if name is None or not re.fullmatch(LOGIN_NAME, name):
        what = "is missing: the broker ties topics to it" if name is None else f"{name!r} is no login's name"
        hint = f'username = "{config.gateway.name}" and password_file = "mqtt.password"'
        raise ConfigError("broker-kit", [Problem("mqtt.username", what, hint)])
    return name


def access_list(logins: Iterable[Login]) -> str:
    """Return Mosquitto's access list; a block for each login, since what has none may do nothing."""
    blocks = (
        f"# {', '.join(sorted(login.roles))}\nuser {login.name}\n"
        + "".join(f"topic {how} {each}\n" for how in ("read", "write") for each in getattr(login, f"{how}s"))
        for login in logins
    )
    return "\n".join([_HEAD, *blocks])


def _named(config: Config, settings: KitSettings) -> Iterator[Login]:
    """Yield the logins that have names of their own."""
    gateway, clients = gateway_login(config), dict.fromkeys(each.client for each in config.operators)
    yield Login(gateway, "", {Role.GATEWAY})
    for name, client in (*((each, each) for each in clients), *settings.further.items()):
        if client not in clients:
            raise UsageError(f"--login {name}={client}: there is no [[operator]] {client}")
        yield Login(name, client, {Role.OPERATOR})
    bridge = ((Role.BRIDGE_UP, (BRIDGE_UP,)), (Role.BRIDGE_DOWN, (BRIDGE_DOWN,))) if settings.bridge else ()
    guests = ((Role.VIEWER, settings.viewers), (Role.AUDITOR, settings.auditors))
    for role, names in (*guests, *bridge, (Role.PROVER, (PROVER,))):
        yield from (Login(name, "", {role}) for name in names)
    if (table := sparkplug_here(config)) is not None:
        node = table.username or ""
        if node in (gateway, *clients) or not re.fullmatch(LOGIN_NAME, node):
            what = "the node needs a login of its own: at this broker a login has one connection at a time"
            own = f'username = "{config.gateway.name}-spb", password_file, ca_file'
            hint = f'urls = ["{config.mqtt.url}"], {own}'
            raise ConfigError("broker-kit", [Problem("sparkplug.username", what, hint)])
        yield Login(node, "", {Role.SPARKPLUG_NODE})
