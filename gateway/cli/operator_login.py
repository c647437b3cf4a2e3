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
from gateway.config.secrets import VARIABLE, mqtt_password, password_in
from gateway.errors import UsageError
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.mqtt.contract.topics import is_level


def add_login(parser: argparse.ArgumentParser, *, client: str) -> None:
    """Add `--client`, with this help, `--username` and `--password-file`."""
    parser.add_argument("--client", metavar="NAME", help=client)
    add_broker_login(parser)


def add_broker_login(parser: argparse.ArgumentParser) -> None:
    """Add `--username` and `--password-file`."""
    parser.add_argument(
        "--username", metavar="NAME", help="the login at the broker, else the configuration's"
    )
    parser.add_argument("--password-file", metavar="FILE", help=f"else ${VARIABLE}, else you are asked")


def settings_of(
    config: Config, folder: Path, *, tool: str, username: str | None, password_file: str | None
) -> BrokerSettings:
    """Return the way to the broker, with a client id of this tool's; ConfigError or UsageError."""
    return broker_of(
        config,
        folder,
        client_id=f"{config.gateway.name}-{tool}-{uuid.uuid4().hex[:8]}",  # never the gateway's own
        username=username or config.mqtt.username,
        password=_password(config, folder, username=username, password_file=password_file),
    )


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


def _password(config: Config, folder: Path, *, username: str | None, password_file: str | None) -> str | None:
    if username is not None or password_file is not None:
        return password_of(username or "", config.mqtt.host, password_file=password_file)
    return mqtt_password(config, folder, os.environ)
