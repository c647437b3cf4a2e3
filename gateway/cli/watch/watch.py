"""Show the starters as a live table, from MQTT alone. q or Ctrl-C ends it."""

from __future__ import annotations

import argparse
import asyncio
import uuid
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from gateway.cli.broker import add_login, password_of, settings_of
from gateway.cli.command import flag
from gateway.client import broker_at
from gateway.config import is_loopback, load
from gateway.contract import is_level
from gateway.errors import UsageError
from gateway.mqtt import BrokerSettings

ALL_GATEWAYS = "starters/+"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
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
    """Show the table until it is ended; BrokerError when the broker cannot be had at first."""
    try:
        from rich.console import Console

        from gateway.cli.watch.watching import Watching
    except ImportError:
        raise UsageError("watch needs the package rich (pip install 'starter-gateway[watch]')") from None
    settings, base = _target(args)
    levels = (args.base or base).split("/")
    if not all(level == "+" or is_level(level) for level in levels):
        raise UsageError(
            f"--base {args.base!r}: each level is + or of a-z, 0-9, _ and - (e.g. {ALL_GATEWAYS})"
        )
    console = Console()
    watching = Watching(console, settings, "/".join(levels))
    with suppress(KeyboardInterrupt):
        asyncio.run(watching.show_once() if args.once or not console.is_terminal else watching.show())
    return 0


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
