"""Four simulated starters, a broker on loopback and the gateway. Ctrl-C ends it."""

from __future__ import annotations

import argparse
import asyncio
import importlib.util
import os
import shlex
import shutil
import sys
import tempfile
from collections.abc import Coroutine
from contextlib import AsyncExitStack, suppress
from pathlib import Path

from gateway.app.site import Site
from gateway.cli.command import flag
from gateway.cli.demo.plant_day import BASE, run_plant
from gateway.cli.demo.processes import (
    DemoBroker,
    demo_broker,
    demo_client,
    demo_simulator,
    free_port,
    waited_for,
)
from gateway.cli.run import log_to_stderr, serve_site
from gateway.errors import GatewayError
from gateway.system.password_hash import password_line

CONFIG, GUIDE = (Path(__file__).with_name(name) for name in ("demo.toml", "guide.txt"))

PAGE_PORT = 8480
PAGE_USER = "demo"  # and its password: the motors are simulated, and only this machine sees the page
PAGE = """
[web]
listen = "127.0.0.1:{port}"

[[web.user]]
name = "{user}"
password = "{line}"
operator = "demo"

[history]
values = ["current"]
"""
METRICS = """
[metrics]
all_points = true
"""

MQTT_BY_HAND = """\
# start and stop with nothing but MQTT
token=$(mosquitto_sub -p {port} -C 1 -t starters/demo/gateway/fresh | cut -d '"' -f 4)
id=$(cat /proc/sys/kernel/random/uuid)
mosquitto_pub -p {port} -q 1 -t starters/demo/command/fan/demo/start \\
  -m "{{\\"id\\":\\"$id\\",\\"token\\":\\"$token\\"}}"
mosquitto_pub -p {port} -q 1 -t starters/demo/command/fan/demo/stop -n
"""
WITH_CLIENTS = {
    "watch": "mosquitto_sub -p {port} -v -t 'starters/demo/#'",
    "trip": "mosquitto_pub -p {port} -t simulator/pump/trip -m E05",
    "by_hand": MQTT_BY_HAND,
}
WITH_PYTHON = {  # where Mosquitto's clients are missing; paho is there
    "watch": '{python} -c "import paho.mqtt.subscribe as s; s.callback('
    "lambda c, u, m: print(m.topic, m.payload.decode(), flush=True), 'starters/demo/#', port={port})\"",
    "trip": '{python} -c "import paho.mqtt.publish as p; '
    "p.single('simulator/pump/trip', 'E05', 1, port={port})\"",
    "by_hand": "",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    flag(parser, "-v", "--verbose", about="log every frame, instead of showing the table")
    flag(parser, "--plant", about="the motors run a small plant's day by themselves, again and again")


def run(args: argparse.Namespace) -> int:
    """Run the demo until Ctrl-C; BrokerError when no broker is to be had."""
    has_table = not args.verbose and sys.stdout.isatty() and importlib.util.find_spec("rich") is not None
    with tempfile.TemporaryDirectory(prefix="starter-gateway-demo-") as name:
        folder = Path(name)
        with (folder / "gateway.log").open("ab") as log:
            log_to_stderr(is_verbose=args.verbose, instead=log.fileno() if has_table else None)
            asyncio.run(_demo(folder, has_table=has_table, has_plant=args.plant))
    return 0


def guide(config: Path, pty: Path, broker: DemoBroker, *, page: str) -> str:
    """Return what can be done with the demo, as lines to paste; without Mosquitto's clients in Python."""
    python, script = shlex.quote(sys.executable), Path(sys.executable).with_name("starter-gateway")
    program = shlex.quote(str(script)) if script.exists() else f"{python} -m gateway"
    has_clients = all(shutil.which(name) for name in ("mosquitto_sub", "mosquitto_pub"))
    lines = WITH_CLIENTS if has_clients else WITH_PYTHON
    return GUIDE.read_text("utf-8").format(
        config=config,
        page=page,
        pty=pty,
        broker=broker.title,
        port=broker.port,
        send=f"{program} send {shlex.quote(str(config))}",
        **{name: line.format(port=broker.port, python=python) for name, line in lines.items()},
    )


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
        async with waited_for("a broker on this machine"):
            broker = await stack.enter_async_context(demo_broker(folder))
        path, (page, table) = folder / "demo.toml", page_of()
        text = CONFIG.read_text("utf-8").format(folder=folder, port=broker.port, version=broker.version)
        path.write_text(text + table, "utf-8")
        site = Site.read(path, os.environ)
        port = Path(site.config.lines[0].port)
        async with waited_for("the simulated starters"):
            await stack.enter_async_context(demo_simulator(path, port=port, broker_port=broker.port))
        print(guide(path, port, broker, page=page), flush=True)
        if has_plant:
            _beside(stack, run_plant(broker.port))
        if has_table:
            from rich.console import Console

            from gateway.cli.watch.watching import Watching

            print(f"The gateway's log is in {folder}/gateway.log\n", flush=True)
            watching = Watching(Console(), demo_client(broker.port), BASE)
            _beside(stack, watching.show(is_full_screen=False))
        await serve_site(path, site)


def _beside(stack: AsyncExitStack, work: Coroutine[None, None, None]) -> None:
    task = asyncio.ensure_future(work)

    async def end() -> None:
        task.cancel()
        with suppress(asyncio.CancelledError, GatewayError):
            await task

    stack.push_async_callback(end)
