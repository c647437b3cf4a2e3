"""A tool at the broker: how it logs in, and a subscription that comes back by itself.

A password comes from a file, the environment or a prompt.
"""

from __future__ import annotations

import argparse
import asyncio
import getpass
import os
import sys
import uuid
from collections.abc import Callable, Iterable
from pathlib import Path

from gateway.client import Client
from gateway.config import VARIABLE, Config, broker_of, password_in, secret_of
from gateway.contract import is_level
from gateway.errors import BrokerError, UsageError
from gateway.mqtt import BrokerSettings, Incoming, Message, Session, SessionParts, connected

AGAIN_S = 2.0  # between two attempts to connect


def add_login(parser: argparse.ArgumentParser, *, client: str = "") -> None:
    """Add `--client` where there is a help text for it, `--username` and `--password-file`."""
    if client:
        parser.add_argument("--client", metavar="NAME", help=client)
    who = (
        "the login at the broker, else the configuration's own: that disconnects a running gateway "
        "where the broker takes logins as client ids, as broker-kit sets it up"
    )
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


def operator_at(config: Config, folder: Path, login: argparse.Namespace) -> Client:
    """Return the way of an operator: the one that was given, else the only one of the configuration.

    `login` has what the options of `add_login` say. ConfigError or UsageError.
    """
    clients = sorted({operator.client for operator in config.operators})
    if login.client is not None:
        clients = [checked_client(login.client)]
    elif not clients:
        raise UsageError("the configuration has no [[operator]]: the gateway is read-only")
    if len(clients) > 1:
        raise UsageError(f"which operator? (--client with one of {', '.join(clients)})")
    settings = settings_of(config, folder, tool="operator", login=login)
    return Client(settings, base=config.base, client=clients[0], operator=user_name())


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


class Subscription:
    """Filters whose messages, retained ones too, are handed on; `trouble` says why none come."""

    def __init__(
        self, settings: BrokerSettings, filters: Iterable[str], on_incoming: Callable[[Incoming], None]
    ) -> None:
        self.trouble = ""
        self._settings = settings
        self._filters = tuple(filters)
        self._on_incoming = on_incoming
        self._session: Session | None = None
        self._sent = 0

    async def connect(self) -> asyncio.Future[str]:
        """Connect and subscribe; the future is done when the connection is lost. BrokerError."""
        session = await connected(self._settings, SessionParts(on_incoming=self._on_incoming))
        for topic in self._filters:
            if not await session.subscribe(topic, with_retained=True):
                session.abort()
                raise BrokerError(
                    f"broker {self._settings.address} does not let {topic} be read",
                    "log in with --username, or look at its access list",
                )
        self._session, self.trouble = session, ""
        return session.lost

    async def stay(self, lost: asyncio.Future[str] | None) -> None:
        """Connect again whenever the connection is lost, until cancelled; None: there is none yet."""
        while True:
            if lost is not None:
                await asyncio.wait([lost])
                self.trouble = f"the connection to {self._settings.address} is lost; trying again"
            await asyncio.sleep(AGAIN_S)
            try:
                lost = await self.connect()
            except BrokerError as error:
                self.trouble = str(error)

    def publish(self, message: Message) -> None:
        """Send a message; without a connection it is dropped."""
        if self._session is not None:
            self._sent += 1
            self._session.publish(self._sent, message)
