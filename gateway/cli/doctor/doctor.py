"""Look for problems: timers and disk of this machine, ports, adapters, clock, state directory, broker, and
in the starters command sources and communication watchdogs. Nothing is changed; exit code 1 when there is a
problem. Run it as the gateway's user.
"""

from __future__ import annotations

import argparse
import asyncio
from pathlib import Path

from gateway.app import io
from gateway.app.capacity import prospects_of
from gateway.cli.broker import add_login, checked_client, settings_of, user_name
from gateway.cli.doctor import machine
from gateway.cli.doctor.findings import Finding, Findings
from gateway.cli.doctor.starters import LineCheckup
from gateway.client import Client
from gateway.config import Config, load, timing_of
from gateway.errors import BrokerError, ConfigError
from gateway.families import Weight
from gateway.line import new_precise_loop
from gateway.mqtt import connected

OWN_NAME = "doctor"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("config", metavar="CONFIG", help="the gateway's configuration")
    who = f"the operator as whom a running gateway is asked, else --username, else {OWN_NAME}"
    add_login(parser, client=who)


def run(args: argparse.Namespace) -> int:
    """Print one finding a line, then the number of errors and warnings."""
    config, findings = load(args.config), Findings()
    client = checked_client(args.client or args.username or OWN_NAME)
    print(f"{args.config}, looked at by user {user_name() or 'without a name'}")
    with asyncio.Runner(loop_factory=new_precise_loop) as runner:
        runner.run(_examine(config, Path(args.config).parent, client, args, findings))
    return findings.verdict()


async def _examine(
    config: Config, folder: Path, client: str, login: argparse.Namespace, findings: Findings
) -> None:
    state_dir = folder / config.gateway.state_dir
    findings.add(machine.clock_finding(), machine.dated_finding(config), machine.state_dir_finding(state_dir))
    findings.add(machine.timers_finding(*await machine.lateness_s()))
    findings.add(machine.disk_finding(machine.sync_s(state_dir)))
    operator = await _operator(config, folder, client, login, findings)
    for prospect in prospects_of(config):
        table = prospect.table
        opener = io.MACHINE.make_opener(table.port, timing_of(table))
        await LineCheckup(prospect, opener, findings, operator, state_dir).run()
        findings.add(machine.latency_finding(table.port, f"line {table.name}"))


async def _operator(
    config: Config, folder: Path, client: str, login: argparse.Namespace, findings: Findings
) -> Client | None:
    """Log in, under another client id than the gateway; return an operator's way, None when there is none.

    With `--username` that login is tried: a second one with the gateway's own could disconnect it.
    """
    who, where = "the gateway's login", "mqtt.password_file"
    try:
        settings = settings_of(config, folder, tool=OWN_NAME)
        if config.mqtt.password_file is not None:
            findings.add(Finding(where, "only its owner may read it"))
        where = f"broker {settings.address}"
        if login.username is not None:
            who = f"the login {login.username}"
            settings = settings_of(config, folder, tool=OWN_NAME, login=login)
        session = await connected(settings)
        await session.disconnect()
    except (BrokerError, ConfigError) as error:
        findings.add(Finding(where, f"{who}: {error}", Weight.ERROR))
        return None
    findings.add(Finding(where, f"takes {who}, MQTT {session.version}"))
    return Client(settings, base=config.base, client=client, operator=user_name())
