"""`starter-gateway watch`: the starters of one gateway or many as a live table, from MQTT alone."""

from __future__ import annotations

import argparse
import asyncio
import time
import uuid
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gateway.cli.command import flag
from gateway.cli.operator_login import add_login, password_of, settings_of
from gateway.cli.watch.overview import Overview
from gateway.client import broker_at
from gateway.config.load import load
from gateway.config.values import is_loopback
from gateway.contract import is_level
from gateway.errors import BrokerError, UsageError
from gateway.mqtt import BrokerSettings, Incoming, connected
from gateway.system.rate_limits import Backoff

if TYPE_CHECKING:
    from rich.console import Console

ALL_GATEWAYS = "starters/+"
TOPICS = (
    "gateway/status",
    "gateway/fresh",
    "starter/+/info",  # only to see that it is withdrawn
    "starter/+/availability",
    "starter/+/state",
    "starter/+/alarm/+",
    "starter/+/value/current",
    "starter/+/value/current_pct",
    "result/+/+",
)
DRAWN_EVERY_S = 0.25
SETTLED_S = 2.5  # retained messages have come by then, and two tokens
AGAIN_S, AGAIN_AT_MOST_S = 0.5, 10.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's description and arguments."""
    parser.description = "Show the starters as a live table, from MQTT alone. Ctrl-C ends it."
    parser.add_argument(
        "target", metavar="CONFIG|URL", help="a gateway's configuration, or a broker: mqtt://host[:port]"
    )
    parser.add_argument(
        "--base",
        metavar="TOPIC",
        help=f"where gateways publish, + for any level (default: the configuration's, else {ALL_GATEWAYS})",
    )
    flag(parser, "--once", about="print the table once; so without a terminal")
    parser.add_argument("--ca-file", metavar="FILE", help="the certificate authority, for mqtts://")
    add_login(parser)


def run(args: argparse.Namespace) -> int:
    """Show the table until Ctrl-C; BrokerError when the broker cannot be had at first."""
    console = new_console()
    settings, base = _target(args)
    watching = Watching(settings, _checked(args.base or base))
    is_once = args.once or not console.is_terminal
    asyncio.run(watching.show_once(console) if is_once else watching.show(console))
    return 0


def new_console() -> Console:
    """Return the terminal; UsageError when `rich` is not installed."""
    try:
        from rich.console import Console
    except ImportError:
        raise UsageError("watch needs the package rich (pip install 'starter-gateway[watch]')") from None
    return Console()


class Watching:
    """One table, fed by one connection that comes back by itself."""

    def __init__(self, settings: BrokerSettings, base: str) -> None:
        self._settings = settings
        self._filters = tuple(f"{base}/{topic}" for topic in TOPICS)
        self._overview = Overview(base)
        self._trouble = ""

    async def show_once(self, console: Console) -> None:
        """Print the table when all that is retained has come."""
        from gateway.cli.watch.table import render

        lost = await self._connect()
        await asyncio.wait([lost], timeout=SETTLED_S)
        console.print(render(self._overview, time.time()))

    async def show(self, console: Console, *, is_full_screen: bool = True) -> None:
        """Draw the table until cancelled; BrokerError only when the first connection fails."""
        from rich.live import Live
        from rich.text import Text

        from gateway.cli.watch.table import render

        lost = await self._connect()
        staying = asyncio.create_task(self._stay_connected(lost))
        try:
            with Live(console=console, screen=is_full_screen, auto_refresh=False) as live:
                while not staying.done():
                    height = console.height - 1 if is_full_screen else console.height
                    shown = render(self._overview, time.time(), height=height - bool(self._trouble))
                    if self._trouble:
                        shown.renderables.insert(0, Text(self._trouble, style="bold white on red"))
                    live.update(shown, refresh=True)
                    await asyncio.sleep(DRAWN_EVERY_S)
        finally:
            staying.cancel()
            with suppress(asyncio.CancelledError):
                await staying

    async def _stay_connected(self, lost: asyncio.Future[str]) -> None:
        backoff = Backoff(AGAIN_S, AGAIN_AT_MOST_S)
        while True:
            await asyncio.wait([lost])
            self._trouble = f"the connection to {self._settings.address} is lost; trying again"
            await asyncio.sleep(backoff.next_s())
            try:
                lost = await self._connect()
            except BrokerError as error:
                self._trouble = str(error)
            else:
                self._trouble = ""
                backoff.reset()

    async def _connect(self) -> asyncio.Future[str]:
        """Connect and subscribe; what is returned is done when the connection is lost."""
        session, _ = await connected(self._settings, on_incoming=self._take)
        for topic_filter in self._filters:
            if not await session.subscribe(topic_filter, with_retained=True):
                raise BrokerError(
                    f"broker {self._settings.address} does not let {topic_filter} be read",
                    "log in with --username, or look at its access list",
                )
        return session.lost

    def _take(self, message: Incoming) -> None:
        self._overview.take(message.topic, message.payload, time.time())


def _target(args: argparse.Namespace) -> tuple[BrokerSettings, str]:
    """Return the way to the broker, and below which topics the gateways are."""
    if "://" not in args.target:
        config = load(args.target)
        return settings_of(config, Path(args.target).parent, tool="watch", login=args), config.base
    settings = broker_at(args.target, client_id=f"watch-{uuid.uuid4().hex[:8]}", ca_file=args.ca_file)
    if args.username:
        if settings.tls is None and not is_loopback(settings.host):
            raise UsageError(f"{args.target}: a password would go unencrypted (use mqtts://)")
        password = password_of(args.username, settings.host, password_file=args.password_file)
        settings = replace(settings, username=args.username, password=password)
    return settings, ALL_GATEWAYS


def _checked(base: str) -> str:
    levels: Sequence[str] = base.split("/")
    if not all(level == "+" or is_level(level) for level in levels):
        raise UsageError(f"--base {base!r}: each level is + or of a-z, 0-9, _ and - (e.g. {ALL_GATEWAYS})")
    return base
