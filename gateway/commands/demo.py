"""`starter-gateway demo`: simulated starters of all families, a broker and the gateway."""

from __future__ import annotations

import argparse
import asyncio
import tempfile
from contextlib import AsyncExitStack
from pathlib import Path

from gateway.commands.command import Subparsers
from gateway.commands.demo_broker import DemoBroker
from gateway.commands.demo_simulator import DemoSimulator
from gateway.commands.run import log_to_stderr, serve
from gateway.config.load import load

CONFIG = """\
[gateway]
name = "demo"
state_dir = "{folder}/state"

[mqtt]
url = "mqtt://127.0.0.1:{port}"

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

GUIDE = """\
Starter Gateway demo. Simulated motors only; Ctrl-C ends everything.

  line    four starters on {pty}, 19200 8N2: pump (SSW-07), fan (SSW-06), mill (SSW900), belt (SST330i)
  broker  {broker} on 127.0.0.1:{port}
  config  {config}

watch     mosquitto_sub -p {port} -v -t 'starters/demo/#'
values    mosquitto_sub -p {port} -v -t 'starters/demo/starter/+/value/current'
start     starter-gateway send {config} pump start --client demo
stop      mosquitto_pub -p {port} -q 1 -t starters/demo/command/pump/demo/stop -n
by hand   token=$(mosquitto_sub -p {port} -C 1 -t starters/demo/gateway/fresh | cut -d '"' -f 4)
          id=$(cat /proc/sys/kernel/random/uuid)
          mosquitto_pub -p {port} -q 1 -t starters/demo/command/fan/demo/start \\
            -m "{{\\"id\\":\\"$id\\",\\"token\\":\\"$token\\"}}"
answers   mosquitto_sub -p {port} -v -t 'starters/demo/result/#'
set       starter-gateway send {config} pump set --client demo parameter=P314 value=30

What a hand at the simulated starter would do has topics of its own, which no real gateway has:
trip      mosquitto_pub -p {port} -t simulator/pump/trip -m E05
others    simulator/STARTER/KNOB: {knobs}
"""

KNOB_GUIDE = "trip E05, alarm A05, clear, control local|remote, power off|on, mains off|on, keypad start|stop"


def add_parser(subparsers: Subparsers) -> None:
    """Add the command's parser."""
    parser = subparsers.add_parser(
        "demo", description="Four simulated starters, a broker on loopback and the gateway. Ctrl-C ends it."
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="log every frame")


def run(args: argparse.Namespace) -> int:
    """Run the demo until Ctrl-C; BrokerError when no broker is to be had."""
    log_to_stderr(is_verbose=args.verbose)
    with tempfile.TemporaryDirectory(prefix="starter-gateway-demo-") as folder:
        asyncio.run(_demo(Path(folder)))
    return 0


async def _demo(folder: Path) -> None:
    async with AsyncExitStack() as stack:
        broker = DemoBroker(folder)
        await broker.start()
        stack.push_async_callback(broker.stop)
        path = folder / "demo.toml"
        path.write_text(CONFIG.format(folder=folder, port=broker.port), "utf-8")
        config = load(path)
        simulator = DemoSimulator(path, broker_port=broker.port)
        await simulator.start()
        stack.push_async_callback(simulator.stop)
        guide = {"pty": config.lines[0].port, "broker": broker.title, "port": broker.port, "config": path}
        print(GUIDE.format(**guide, knobs=KNOB_GUIDE), flush=True)
        await serve(path, config, None)
