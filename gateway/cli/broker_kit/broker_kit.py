"""`starter-gateway broker-kit`: writes what a Mosquitto needs for a gateway, and proves it as it runs."""

from __future__ import annotations

import argparse
import asyncio
from pathlib import Path

from gateway.cli.broker_kit.bridge import bridge_logins
from gateway.cli.broker_kit.certificates import BROKER_DAYS, CA, CA_KEY, CERT, ends_on
from gateway.cli.broker_kit.folder import CENTRAL, FOLDER, is_kit
from gateway.cli.broker_kit.kit import write_kit
from gateway.cli.broker_kit.logins import logins_of
from gateway.cli.broker_kit.proof import BrokerProof
from gateway.cli.broker_kit.rights import Login, remote_clients
from gateway.cli.broker_kit.settings import KitSettings
from gateway.cli.command import flag
from gateway.cli.doctor.machine import dated_finding
from gateway.config import Config, load, password_in
from gateway.errors import UsageError

_REPEATED = {  # option: metavar, the kit's option that it sets, help
    "--host": ("NAME", "hosts", "a name or address of the broker, for its certificate; else mqtt.url's"),
    "--viewer": ("NAME", "viewers", "a login that may only look on; else viewer"),
    "--auditor": ("NAME", "auditors", "a login that reads events and audit; else auditor"),
    "--login": ("NAME=OPERATOR", "further", "a further login of an operator, for a second program"),
}
_ONCE = {
    "--bridge": ("HOST[:PORT]", "a central broker: adds a bridge to it"),
    "--bridge-base": ("BASE", "base of this gateway's topics at the central broker, else mqtt.base"),
    "--bridge-ca": ("FILE", "the central broker's authority, PEM, else those of the system"),
    "--ca": ("FILE", "the plant's authority, PEM, in place of a new one; with --cert and --key"),
    "--cert": ("FILE", "the broker's certificate, PEM, with what lies between it and the authority"),
    "--key": ("FILE", "the broker's private key, PEM"),
    "--like": ("DIR", "the kit of another gateway at the same broker: its authority and passwords"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's description and arguments."""
    parser.description = (
        "Write Mosquitto's configuration, access list, passwords and certificates for a gateway"
        " into a folder; with --prove, try on the running broker that each login may do what it must, and"
        " nothing else. Exit code 1 when the proof finds something wrong."
    )
    parser.add_argument("config", metavar="CONFIG", help="the gateway's configuration")
    parser.add_argument("folder", metavar="DIR", help="the folder of the kit; only its owner may read it")
    actions = parser.add_mutually_exclusive_group()
    flag(actions, "--prove", about="prove the kit on the running broker of CONFIG")
    about = "write a kit again after a change of CONFIG or of the options below: stored passwords and the"
    about += " authority stay, the broker's certificate is signed again"
    flag(actions, "--update", about=about)
    flag(actions, "--force", about="replace a kit, with new passwords and certificates")
    about = "contents of the kit (an update keeps the previous ones; '' takes one away)"
    contents = parser.add_argument_group(about)
    for name, (metavar, sets, about) in _REPEATED.items():
        about += "; may be repeated"
        contents.add_argument(name, action="append", dest=sets, metavar=metavar, help=about)
    for name, (metavar, about) in _ONCE.items():
        contents.add_argument(name, metavar=metavar, help=about)


def run(args: argparse.Namespace) -> int:
    """Write or prove; return 1 when something is wrong."""
    config, folder = load(args.config), Path(args.folder)
    if args.prove:
        return _prove(config, Path(args.config).parent, folder)
    if is_kit(folder) and not (args.update or args.force):
        what = "--update adds what is new, --force replaces it with its passwords"
        raise UsageError(f"{folder} holds a kit ({what})")
    settings = (KitSettings.read(folder) if args.update else KitSettings()).changed(args)
    old = [*([folder] if args.update else []), *([Path(args.like)] if args.like else [])]
    if args.like and not is_kit(old[-1]):
        raise UsageError(f"--like {args.like} is no kit")
    logins = write_kit(config, folder, settings, _given(args), old)
    _describe(config, folder, settings, logins)
    return 0


def _given(args: argparse.Namespace) -> dict[str, Path]:
    """Return the files that the plant gives; UsageError."""
    names = ("ca", "cert", "key", "bridge_ca")
    given = {name: Path(getattr(args, name)) for name in names if getattr(args, name)}
    if 0 < len(given.keys() - {"bridge_ca"}) < 3:
        raise UsageError("--ca, --cert and --key go together")
    for path in given.values():
        if not path.is_file():
            raise UsageError(f"{path} is no file")
    return given


def _describe(config: Config, folder: Path, settings: KitSettings, logins: tuple[Login, ...]) -> None:
    """Print what was written, and what is the reader's to do."""
    print(f"{folder}: mosquitto.conf, acl, passwords; each login's password in {folder / FOLDER}:")
    width = max(len(login.name) for login in logins)
    for login in logins:
        whose = f" of {login.client}" if login.client not in ("", login.name) else ""
        print(f"  {login.name:{width}}  {', '.join(sorted(login.roles))}{whose}")
    if config.mqtt.is_tls:
        ends = ends_on(folder / CERT), ends_on(folder / CA)
        print(f"the broker's certificate is valid until {ends[0]}, its authority until {ends[1]}")
        if (folder / CA_KEY).exists():
            print(
                f"  --update signs the next one, within {BROKER_DAYS} days; store {CA_KEY} off this machine"
            )
    if settings.bridge:
        up, down = bridge_logins(config)
        remote = remote_clients(config)
        print(f"the bridge to {settings.bridge}: bridge.conf; for the central broker: {folder / CENTRAL}")
        print(f"  logins {up} and {down}; commands of {', '.join(remote) or 'no operator'} come in")
        if not remote:
            print('  (an [[operator]] with freshness = "issued_at" may command over the bridge)')
        if dated := dated_finding(config):
            print(dated)
    print("install and prove it: docs/broker.md")


def _prove(config: Config, place: Path, folder: Path) -> int:
    """Prove the rights of every login of the kit, and print what is wrong; 1 when something is."""
    logins = logins_of(config, KitSettings.read(folder))
    passwords = {login.name: password_in(folder / FOLDER / login.name, key="password") for login in logins}
    proof = BrokerProof(config, place, logins, passwords)
    findings = asyncio.run(proof.run())
    for finding in findings:
        print(finding)
    wrong = sum(finding.weight is not None for finding in findings)
    print(f"{proof.probes} probes, {wrong} wrong")
    return 1 if wrong else 0
