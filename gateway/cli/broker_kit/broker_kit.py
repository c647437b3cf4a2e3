"""Write Mosquitto's configuration, access list, passwords and certificates for a gateway into a folder; with
--prove, try on the running broker that each login may do what it must, and nothing else. Exit code 1 when the
proof finds something wrong.
"""

from __future__ import annotations

import argparse
import asyncio
from functools import partial
from pathlib import Path

from gateway.cli.broker_kit.certificates import BROKER_DAYS, CA, CA_KEY, CERT, ends_on
from gateway.cli.broker_kit.kit import CENTRAL, is_kit, write_kit
from gateway.cli.broker_kit.logins import FOLDER, logins_of
from gateway.cli.broker_kit.proof import BrokerProof
from gateway.cli.broker_kit.rights import Login, remote_clients
from gateway.cli.broker_kit.settings import OPTIONS, KitSettings, checked
from gateway.cli.command import flag
from gateway.cli.doctor.findings import Findings
from gateway.cli.doctor.machine import dated_finding
from gateway.config import Config, load, password_in
from gateway.errors import UsageError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("config", metavar="CONFIG", help="the gateway's configuration")
    parser.add_argument("folder", metavar="DIR", help="the folder of the kit; only its owner may read it")
    actions = parser.add_mutually_exclusive_group()
    flag(actions, "--prove", about="prove the kit on the running broker of CONFIG")
    about = "write a kit again after a change of CONFIG or of the options below: stored passwords and the"
    about += " authority stay, the broker's certificate is signed again"
    flag(actions, "--update", about=about)
    about = "contents of the kit (an update keeps the previous ones; '' takes one away)"
    contents = parser.add_argument_group(about)
    for name, field, metavar, pattern, about in OPTIONS:
        is_one = isinstance(KitSettings.model_fields[field].default, str)
        contents.add_argument(
            name,
            action="store" if is_one else "append",
            dest=field,
            metavar=metavar,
            type=partial(checked, pattern=pattern, metavar=metavar),
            help=about + ("" if is_one else "; may be repeated"),
        )


def run(args: argparse.Namespace) -> int:
    """Write or prove; return 1 when something is wrong."""
    config, folder = load(args.config), Path(args.folder)
    if args.prove:
        return _prove(config, Path(args.config).parent, folder)
    if is_kit(folder) and not args.update:
        raise UsageError(
            f"{folder} holds a kit (--update adds what is new; to begin again, remove the folder)"
        )
    settings = (KitSettings.read(folder) if args.update else KitSettings()).changed(args)
    _describe(config, folder, settings, write_kit(config, folder, settings))
    return 0


def _describe(config: Config, folder: Path, settings: KitSettings, logins: tuple[Login, ...]) -> None:
    """Print what was written, and what is the reader's to do."""
    print(f"{folder}: mosquitto.conf, acl, passwords; each login's password in {folder / FOLDER}:")
    width = max(len(login.name) for login in logins)
    for login in logins:
        whose = f" of {login.client}" if login.client not in ("", login.name) else ""
        print(f"  {login.name:{width}}  {', '.join(sorted(login.roles))}{whose}")
    if config.mqtt.is_tls:
        cert, ca = ends_on(folder / CERT), ends_on(folder / CA)
        print(f"the broker's certificate is valid until {cert}, its authority until {ca}")
        if (folder / CA_KEY).exists():
            print(f"  --update signs the next, within {BROKER_DAYS} days; store {CA_KEY} off this machine")
    if settings.bridge:
        print(f"the bridge to {settings.bridge}: bridge.conf; for the central broker: {folder / CENTRAL}")
        remote = ", ".join(remote_clients(config))
        none = 'no commands come in: no [[operator]] has freshness = "issued_at"'
        print(f"  commands of {remote} come in" if remote else f"  {none}")
        if dated := dated_finding(config):
            print(dated)
    print("install and prove it: docs/broker.md")


def _prove(config: Config, place: Path, folder: Path) -> int:
    """Prove the rights of every login of the kit, and print what is wrong; 1 when something is."""
    logins = logins_of(config, KitSettings.read(folder))
    for login in logins:
        login.password = password_in(folder / FOLDER / login.name, key="password")
    proof, findings = BrokerProof(config, place, logins), Findings()
    asyncio.run(proof.run())
    findings.add(*proof.findings())
    return findings.verdict()
