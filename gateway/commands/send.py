"""`starter-gateway send`: a command over MQTT, as an operator's program would send it."""

from __future__ import annotations

import argparse
import asyncio
import getpass
import os
import sys
import time
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gateway.commands.command import Subparsers
from gateway.commands.words import arguments
from gateway.config.load import load
from gateway.config.schema import Config
from gateway.config.secrets import VARIABLE, mqtt_password, password_in
from gateway.config.setups import tls_files_of
from gateway.errors import UsageError
from gateway.mqtt.sender import Order, Sender
from gateway.mqtt.settings import BrokerSettings, TlsSettings
from gateway.mqtt.topics import Topics, is_level
from gateway.starters.records import Phase


def add_parser(subparsers: Subparsers) -> None:
    """Add the command's parser."""
    parser = subparsers.add_parser(
        "send",
        description="Send a command over MQTT and show its phases; exit code 0 only when it is confirmed.",
    )
    parser.add_argument(
        "config", metavar="CONFIG", help="the gateway's configuration, or one with its broker"
    )
    parser.add_argument("starter", metavar="STARTER", help="the starter's name")
    parser.add_argument("verb", metavar="VERB", help="start, stop, reset, set, read ...")
    parser.add_argument("args", metavar="KEY=VALUE", nargs="*", help="e.g. parameter=P314 value=30")
    parser.add_argument(
        "--client", metavar="NAME", help="the operator; may be left out when there is only one"
    )
    parser.add_argument(
        "--username", metavar="NAME", help="the login at the broker, else the configuration's"
    )
    parser.add_argument("--password-file", metavar="FILE", help=f"else ${VARIABLE}, else you are asked")
    parser.add_argument(
        "--timeout", metavar="S", type=float, default=30.0, help="seconds to wait for the end"
    )


def run(args: argparse.Namespace) -> int:
    """Send, print each phase on a line, and return 0 only for a confirmed command."""
    config = load(args.config)
    starters = [starter.name for line in config.lines for starter in line.starters]
    if args.starter not in starters:
        raise UsageError(f"no starter {args.starter!r} (one of {', '.join(starters)})")
    if not is_level(args.verb):
        raise UsageError(f"no verb {args.verb!r} (start, stop, reset, set, read ...)")
    order = Order(
        starter=args.starter,
        client=_client(config, args.client),
        verb=args.verb,
        args=arguments(args.args),
        operator=_who(),
    )
    sender = Sender(_settings(config, args), Topics(config.base))
    sending = sender.send(order, now_s=time.time(), within_s=args.timeout, on_phase=_show)
    result = asyncio.run(sending)
    if result is None:
        what = f"no final result within {args.timeout:g} s: look at the starter before you try again"
        print(f"starter-gateway: {what} (is {order.client} allowed to write commands?)", file=sys.stderr)
        return 1
    _show(result)
    return 0 if result["phase"] == Phase.CONFIRMED else 1


def _who() -> str | None:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a user without a name, as in some containers
        return None


def _client(config: Config, client: str | None) -> str:
    if client is not None:
        if not is_level(client):
            raise UsageError(f"--client {client!r} is no name (only a-z, 0-9, _ and -)")
        return client
    clients = sorted({operator.client for operator in config.operators})
    if len(clients) == 1:
        return clients[0]
    if not clients:
        raise UsageError("the configuration has no [[operator]]: the gateway is read-only")
    raise UsageError(f"which operator? (--client with one of {', '.join(clients)})")


def _settings(config: Config, args: argparse.Namespace) -> BrokerSettings:
    folder = Path(args.config).parent
    username = args.username or config.mqtt.username
    return BrokerSettings(
        host=config.mqtt.host,
        port=config.mqtt.port,
        client_id=f"{config.gateway.name}-send-{uuid.uuid4().hex[:8]}",  # never the gateway's own
        username=username,
        password=_password(config, args, folder),
        tls=TlsSettings(*tls_files_of(config, folder)) if config.mqtt.is_tls else None,
        keepalive_s=config.mqtt.keepalive_s,
    )


def _password(config: Config, args: argparse.Namespace, folder: Path) -> str | None:
    if args.password_file is not None:
        return password_in(Path(args.password_file))
    if args.username is None:
        return mqtt_password(config, folder, os.environ)
    if VARIABLE in os.environ:
        return os.environ[VARIABLE]
    if not sys.stdin.isatty():
        raise UsageError(f"no password for {args.username} (--password-file, or ${VARIABLE})")
    return getpass.getpass(f"Password of {args.username} at {config.mqtt.host}: ")


def _show(result: Mapping[str, Any]) -> None:
    """Print one phase: what the gateway said of it, and the value when it read one."""
    phase, code = str(result.get("phase")), result.get("code")
    text = str(result.get("text") or "").removeprefix(phase).lstrip("; ")
    line = phase if code in (None, "", "ok", phase) else f"{phase} [{code}]"
    if text:
        line += f": {text}"
    if "value" in result:
        line += f" = {_spoken(result)}"
    print(line, flush=True)
    for parameter, told in (result.get("values") or {}).items():
        print(f"  {parameter} = {_spoken(told)}", flush=True)


def _spoken(told: Mapping[str, Any]) -> str:
    """Return a value with its unit, or what the manual calls it."""
    return str(told.get("label") or f"{told['value']} {told.get('unit') or ''}".rstrip())
