"""`starter-gateway demo`: simulated starters of all families, a broker and the gateway."""

from __future__ import annotations

import argparse
import asyncio
import importlib.util
import shlex
import shutil
import sys
import tempfile
from collections.abc import Coroutine
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from typing import Any

from gateway.cli.command import flag
from gateway.cli.demo.plant_day import BASE, run_plant
from gateway.cli.demo.processes import (
    PORT,
    demo_broker,
    demo_client,
    demo_simulator,
    free_port,
    publish,
    watch,
)
from gateway.cli.run import log_to_stderr, serve
from gateway.config.load import load
from gateway.errors import GatewayError, UsageError
from gateway.system.password_hash import password_line

CONFIG = """\
[gateway]
name = "demo"
state_dir = "{folder}/state"

[mqtt]
url = "mqtt://127.0.0.1:{port}"
version = "{version}"

[[line]]
name = "virtual"
port = "{folder}/ttyDEMO"
baud = 19200
framing = "8N2"            # the one byte format that all four families know

[[line.starter]]
name = "pump"
address = 1
family = "ssw07"
model = "SSW-07 85A"

[[line.starter]]
name = "fan"
address = 2
family = "ssw06"
model = "SSW-06 820A"

[[line.starter]]
name = "mill"
address = 3
family = "ssw900"

[[line.starter]]
name = "belt"
address = 4
family = "sst"

[[operator]]
client = "demo"
may = ["*"]
starters = ["*"]
"""

PAGE_PORT = 8480
PAGE_USER = "demo"  # and its password: the motors are simulated, and only this machine sees the page
PAGE = """
[web]
listen = "127.0.0.1:{port}"

[[web.user]]
name = "{user}"
password = "{line}"
operator = "demo"
"""
METRICS = """
[metrics]
all_points = true
"""

GUIDE = """\
Starter Gateway demo. Simulated motors only; Ctrl-C ends everything.

  page    {page}
  line    four starters on {pty}, 19200 8N2: pump (SSW-07), fan (SSW-06), mill (SSW900), belt (SST330i)
  broker  {broker} on 127.0.0.1:{port}
  config  {config}

Paste these into another terminal:

# watch
{watch} 'starters/demo/#'
# start, stop, set, read
{send} pump start --client demo
{send} pump stop --client demo
{send} pump set --client demo parameter=P314 value=30
{send} pump read --client demo parameter=P003
{by_hand}
What a person beside a simulated starter would do has topics, which no real gateway has:

# trip
{trip}
others    simulator/STARTER/KNOB: {knobs}
"""

BY_HAND = """\
# start and stop with nothing but MQTT
token=$(mosquitto_sub -p {port} -C 1 -t starters/demo/gateway/fresh | cut -d '"' -f 4)
id=$(cat /proc/sys/kernel/random/uuid)
mosquitto_pub -p {port} -q 1 -t starters/demo/command/fan/demo/start \\
  -m "{{\\"id\\":\\"$id\\",\\"token\\":\\"$token\\"}}"
mosquitto_pub -p {port} -q 1 -t starters/demo/command/fan/demo/stop -n
"""

KNOB_GUIDE = (
    "trip E05, alarm A05, clear, control local|remote, power off|on, mains off|on, keypad start|stop, "
    "load 80, friction 20, wear 2, thermal 90, voltage 85 2.5, phase r|s|t|on"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's description and arguments."""
    parser.description = "Four simulated starters, a broker on loopback and the gateway. Ctrl-C ends it."
    flag(parser, "-v", "--verbose", about="log every frame, instead of showing the table")
    flag(parser, "--plant", about="the motors run a small plant's day by themselves, again and again")
    parser.add_argument(
        "--broker",
        metavar="PORT",
        type=int,
        default=PORT,
        help="of a demo that runs, for --watch and --publish",
    )
    client = parser.add_mutually_exclusive_group()
    client.add_argument("--watch", metavar="TOPIC", help="print what a demo publishes, until Ctrl-C")
    client.add_argument(
        "--publish", metavar="TOPIC=PAYLOAD", help="publish to a demo, as mosquitto_pub would do"
    )


def run(args: argparse.Namespace) -> int:
    """Run the demo until Ctrl-C; BrokerError when no broker is to be had."""
    if args.watch is not None:
        _as_client(watch(args.broker, args.watch), f"--watch {args.watch!r}")
        return 0
    if args.publish is not None:
        topic, sign, payload = args.publish.partition("=")
        if not sign or not topic:
            raise UsageError(f"--publish {args.publish!r} is not TOPIC=PAYLOAD")
        _as_client(publish(args.broker, topic, payload), f"--publish {args.publish!r}")
        return 0
    has_table = not args.verbose and sys.stdout.isatty() and importlib.util.find_spec("rich") is not None
    with tempfile.TemporaryDirectory(prefix="starter-gateway-demo-") as name:
        folder = Path(name)
        with (folder / "gateway.log").open("ab") as log:
            log_to_stderr(is_verbose=args.verbose, instead=log.fileno() if has_table else None)
            asyncio.run(_demo(folder, has_table=has_table, has_plant=args.plant))
    return 0


def _as_client(work: Coroutine[Any, Any, None], option: str) -> None:
    try:
        asyncio.run(work)
    except ValueError as error:  # paho's, of a topic that MQTT does not allow
        raise UsageError(f"{option}: {error}") from None


def guide(config: Path, pty: str, broker: str, port: int, *, page: str, has_clients: bool) -> str:
    """Return what can be done with the demo, as lines to paste; without Mosquitto's clients by our own."""
    program = program_words()
    return GUIDE.format(
        config=config,
        page=page,
        pty=pty,
        broker=broker,
        port=port,
        send=f"{program} send {shlex.quote(str(config))}",
        watch=f"mosquitto_sub -p {port} -v -t" if has_clients else f"{program} demo --broker {port} --watch",
        trip=f"mosquitto_pub -p {port} -t simulator/pump/trip -m E05"
        if has_clients
        else f"{program} demo --broker {port} --publish simulator/pump/trip=E05",
        by_hand=BY_HAND.format(port=port) if has_clients else "",
        knobs=KNOB_GUIDE,
    )


def program_words() -> str:
    """Return how this program is called from any folder: its full path, quoted for a shell."""
    script = Path(sys.executable).parent / "starter-gateway"
    return shlex.quote(str(script)) if script.exists() else f"{shlex.quote(sys.executable)} -m gateway"


def page_of() -> tuple[str, str]:
    """Return where the page is, with its login, and its part of the configuration; none without packages."""
    if any(importlib.util.find_spec(name) is None for name in ("starlette", "uvicorn")):
        return "none here: pip install 'starter-gateway[web]'", ""
    port = free_port(PAGE_PORT)
    table = PAGE.format(port=port, user=PAGE_USER, line=password_line(PAGE_USER))
    if importlib.util.find_spec("prometheus_client") is not None:
        table += METRICS
    return f"http://127.0.0.1:{port}/ (to operate, log in as {PAGE_USER}, password {PAGE_USER})", table


async def _demo(folder: Path, *, has_table: bool, has_plant: bool) -> None:
    async with AsyncExitStack() as stack:
        port, broker, version = await stack.enter_async_context(demo_broker(folder))
        path = folder / "demo.toml"
        page, table = page_of()
        path.write_text(CONFIG.format(folder=folder, port=port, version=version) + table, "utf-8")
        config = load(path)
        await stack.enter_async_context(demo_simulator(path, broker_port=port))
        has_clients = all(shutil.which(name) for name in ("mosquitto_sub", "mosquitto_pub"))
        print(guide(path, config.lines[0].port, broker, port, page=page, has_clients=has_clients), flush=True)
        if has_plant:
            _beside(stack, run_plant(port))
        if has_table:
            print(f"The gateway's log is in {folder}/gateway.log\n", flush=True)
            from rich.console import Console

            from gateway.cli.watch.watching import Watching

            _beside(stack, Watching(Console(), demo_client(port), BASE).show(is_full_screen=False))
        await serve(path, config, None)


def _beside(stack: AsyncExitStack, work: Coroutine[None, None, None]) -> None:
    task = asyncio.ensure_future(work)

    async def end() -> None:
        task.cancel()
        with suppress(asyncio.CancelledError, GatewayError):
            await task

    stack.push_async_callback(end)
