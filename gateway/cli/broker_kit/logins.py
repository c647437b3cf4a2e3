"""Who logs in at the broker: the access list that says so to Mosquitto, and the passwords.

Each password is in a file of its own. A line of Mosquitto's password file is `name:$7$ITERATIONS$SALT$HASH`:
PBKDF2 with SHA-512, salt and hash in base64 [mosquitto_passwd(1); RFC 8018 5.2].
"""

from __future__ import annotations

import base64
import hashlib
import re
import secrets
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from gateway.cli.broker_kit.rights import (
    PROBE,
    Login,
    Role,
    clients_of,
    give_rights,
    remote_clients,
    sparkplug_here,
)
from gateway.cli.broker_kit.settings import LOGIN_NAME, KitSettings
from gateway.config import Config, password_in
from gateway.errors import ConfigError, Problem, UsageError

FOLDER = "logins"  # of a kit: one file a login
PROVER = "prover"  # reads everything, for the proof
NOTICE = "bridge"  # below the central base: 1 while the telemetry's connection is there, else 0; retained

_HOME_ASSISTANT, _SPARKPLUG_HOST = "home-assistant", "sparkplug-host"  # where no [[operator]] is named
_ITERATIONS = 101  # mosquitto_passwd's; no number of them could improve passwords of 160 bits
_SALT_BYTES, _HASH_BYTES = 12, 64
_HEAD = """\
# Who may do what at the broker; written by `starter-gateway broker-kit`, from [[operator]] and mqtt.base.
#
# The gateway trusts the client's name in a command's topic because of this file: each login writes commands
# only under its own name. One block for each, on purpose: a `pattern write` would also let those write who
# should only look on. Logins without a block may do nothing.
"""


def logins_of(config: Config, settings: KitSettings) -> tuple[Login, ...]:
    """Return every login with its rights; ConfigError or UsageError when two would have one name."""
    found = _by_name(_named(config, settings))
    spb, home = sparkplug_here(config), config.home_assistant
    if home is not None:
        _add_role(found, home.operator or _HOME_ASSISTANT, Role.HOME_ASSISTANT)
    if spb is not None:
        _add_role(found, spb.operator or _SPARKPLUG_HOST, Role.SPARKPLUG_HOST)
    give_rights(found.values(), config, base=config.base, central_base=settings.central_base(config))
    return tuple(login for login in found.values() if login.roles != {Role.BRIDGE_DOWN} or login.writes)


def central_logins(config: Config, base: str) -> tuple[Login, ...]:
    """Return who logs in at the central broker for this site, with rights below this site's base only.

    UsageError for an operator with the name of one of the bridge's logins, who would have its rights.
    """
    name = gateway_login(config)
    up, down = Login(f"{name}-up", "", {Role.BRIDGE_UP}), Login(f"{name}-down", "", {Role.BRIDGE_DOWN})
    operators = [Login(client, client, {Role.OPERATOR}) for client in remote_clients(config)]
    give_rights((up, down, *operators), config, base=base, central_base=base)
    for bridge in (up, down):  # it puts there what it takes here, and the other way round
        bridge.reads, bridge.writes = bridge.writes, bridge.reads
    for filters in (up.writes, *(login.reads for login in operators)):
        filters.append(f"{base}/{NOTICE}")
    return tuple(_by_name((up, *([down] if down.reads else ()), *operators)).values())


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
    lines = [_HEAD]
    for login in logins:
        lines += [f"# {', '.join(sorted(login.roles))}", f"user {login.name}"]
        lines += [f"topic read {topic}" for topic in login.reads]
        lines += [f"topic write {topic}" for topic in login.writes]
        lines.append("")
    return "\n".join(lines)


def write_logins(folder: Path, logins: Sequence[Login], *, stored: Path) -> None:
    """Write an access list, Mosquitto's password file, and each login's password in a file of its own.

    The passwords are those that the folder `stored` has, else new ones.
    """
    (folder / FOLDER).mkdir(mode=0o700, parents=True)
    for login in logins:
        is_known = (stored / FOLDER / login.name).exists()
        login.password = password_in(stored / FOLDER / login.name) if is_known else secrets.token_urlsafe(20)
        (folder / FOLDER / login.name).write_text(f"{login.password}\n", "utf-8")
    (folder / "passwords").write_text("".join(map(_password_line, logins)), "utf-8")
    (folder / "acl").write_text(access_list(logins), "utf-8")


def _password_line(login: Login) -> str:
    salt = secrets.token_bytes(_SALT_BYTES)
    digest = hashlib.pbkdf2_hmac("sha512", login.password.encode(), salt, _ITERATIONS, _HASH_BYTES)
    salt_text, digest_text = (base64.b64encode(raw).decode("ascii") for raw in (salt, digest))
    return f"{login.name}:$7${_ITERATIONS}${salt_text}${digest_text}\n"


def _by_name(logins: Iterable[Login]) -> dict[str, Login]:
    """Return logins by their names; UsageError when two would have one, or one that of the proof's probes."""
    found: dict[str, Login] = {}
    for login in logins:
        if login.name in found or PROBE in (login.name, login.client):
            raise UsageError(f"two logins have the name {login.name} (each needs one of its own)")
        found[login.name] = login
    return found


def _add_role(logins: dict[str, Login], name: str, role: Role) -> None:
    logins.setdefault(name, Login(name)).roles.add(role)


def _named(config: Config, settings: KitSettings) -> Iterator[Login]:
    """Yield the logins that have names of their own."""
    gateway, clients = gateway_login(config), clients_of(config)
    yield Login(gateway, "", {Role.GATEWAY})
    for name, client in (*zip(clients, clients, strict=True), *settings.further.items()):
        if client not in clients:
            raise UsageError(f"--login {name}={client}: there is no [[operator]] {client}")
        yield Login(name, client, {Role.OPERATOR})
    bridge = [("bridge-up", Role.BRIDGE_UP), ("bridge-down", Role.BRIDGE_DOWN)] if settings.bridge else []
    guests = [(name, Role.VIEWER) for name in settings.viewers]
    guests += [(name, Role.AUDITOR) for name in settings.auditors]
    yield from (Login(name, "", {role}) for name, role in (*guests, *bridge, (PROVER, Role.PROVER)))
    if (table := sparkplug_here(config)) is not None:
        node = table.username or ""
        if node in (gateway, *clients) or not re.fullmatch(LOGIN_NAME, node):
            what = "the node needs a login of its own: at this broker a login has one connection at a time"
            hint = f'urls = ["{config.mqtt.url}"], username = "{config.gateway.name}-spb", password_file'
            hint += ", ca_file" if config.mqtt.is_tls else ""
            raise ConfigError("broker-kit", [Problem("sparkplug.username", what, hint)])
        yield Login(node, "", {Role.SPARKPLUG_NODE})
