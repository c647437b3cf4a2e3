"""How a tool logs in at the broker: with a password from a file, the environment or a prompt."""

from __future__ import annotations

import argparse
import getpass
import os
import sys
import uuid
from pathlib import Path

from gateway.config.convert import broker_of
from gateway.config.schema import Config
from gateway.config.secrets import VARIABLE, password_in, secret_of
from gateway.contract import is_level
from gateway.errors import UsageError
from gateway.mqtt import BrokerSettings


def add_login(parser: argparse.ArgumentParser, *, client: str = "") -> None:
    """Add `--client` where there is a help text for it, `--username` and `--password-file`."""
    if client:
        parser.add_argument("--client", metavar="NAME", help=client)
    who = "the login at the broker, else the configuration's"
    parser.add_argument("--username", metavar="NAME", help=who)
    parser.add_argument("--password-file", metavar="FILE", help=f"else ${VARIABLE}, else you are asked")


def settings_of(
    config: Config, folder: Path, *, tool: str, login: argparse.Namespace | None = None
) -> BrokerSettings:
    """Return the way to the broker, with a client id of this tool's; ConfigError or UsageError.

    `login` has what the options of `add_login` say; without them it is the configuration's login.
    """
    username, file = (None, None) if login is None else (login.username, login.password_file)
    if username is None and file is None:
        password = secret_of("mqtt", config, folder, os.environ)
    else:
        password = password_of(username or "", config.mqtt.host, password_file=file)
    return broker_of(
        config.mqtt,
        folder,
        client_id=f"{config.gateway.name}-{tool}-{uuid.uuid4().hex[:8]}",  # never the gateway's own
        username=username or config.mqtt.username,
        password=password,
    )


def client_of(config: Config, given: str | None) -> str:
    """Return the operator that was given, else the only one of the configuration; UsageError without."""
    if given is not None:
        return checked_client(given)
    clients = sorted({operator.client for operator in config.operators})
    if not clients:
        raise UsageError("the configuration has no [[operator]]: the gateway is read-only")
    if len(clients) > 1:
        raise UsageError(f"which operator? (--client with one of {', '.join(clients)})")
    return clients[0]


def checked_client(client: str) -> str:
    """Return a client's name; UsageError when it is no level of a topic."""
    if not is_level(client):
        raise UsageError(f"--client {client!r} is no name (only a-z, 0-9, _ and -)")
    return client


def user_name() -> str | None:
    """Return the name of the user who runs this; None when it has none, as in some containers."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return None


def password_of(username: str, host: str, *, password_file: str | None) -> str:
    """Return a login's password: of the file, the environment or the prompt; UsageError without any."""
    if password_file is not None:
        return password_in(Path(password_file))
    if VARIABLE in os.environ:
        return os.environ[VARIABLE]
    if not sys.stdin.isatty():
        raise UsageError(f"no password for {username} (--password-file, or ${VARIABLE})")
    return getpass.getpass(f"Password of {username} at {host}: ")
