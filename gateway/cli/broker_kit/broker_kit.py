"""`starter-gateway broker-kit`: writes what a Mosquitto needs for a gateway, and proves it as it runs."""

from __future__ import annotations

import argparse
import asyncio
import re
from pathlib import Path

from gateway.cli.broker_kit.bridge import bridge_logins
from gateway.cli.broker_kit.certificates import BROKER_DAYS, CA, CA_KEY, CERT, ends_on, names_in
from gateway.cli.broker_kit.folder import CENTRAL, FOLDER, is_kit
from gateway.cli.broker_kit.kit import GivenFiles, read_settings, write_kit
from gateway.cli.broker_kit.lint import warnings
from gateway.cli.broker_kit.logins import KitSettings, Login, logins_of
from gateway.cli.broker_kit.proof import BrokerProof
from gateway.cli.broker_kit.rights import remote_clients
from gateway.cli.command import flag
from gateway.cli.doctor.machine import dated_finding
from gateway.config.load import load
from gateway.config.schema import Config
from gateway.config.secrets import password_in
from gateway.errors import UsageError

_HOST = re.compile(r"(\*\.)?[A-Za-z0-9_]([A-Za-z0-9._-]*[A-Za-z0-9_])?|[0-9A-Fa-f:.]*:[0-9A-Fa-f:.]*")
_CONTENTS = {  # option: metavar, help, and what it sets in the kit's settings
    "--host": ("NAME", "a name or address of the broker, for its certificate; else mqtt.url's", "hosts"),
    "--viewer": ("NAME", "a login that may only look on; else viewer", "viewers"),
    "--auditor": ("NAME", "a login that reads events and audit; else auditor", "auditors"),
    "--login": ("NAME=OPERATOR", "a further login of an operator, for a second program", "further"),
    "--bridge": ("HOST[:PORT]", "a central broker: adds a bridge to it", "bridge"),
    "--bridge-base": (
        "BASE",
        "base of this gateway's topics at the central broker, else mqtt.base",
        "bridge_base",
    ),
    "--bridge-ca": ("FILE", "the central broker's authority, PEM, else those of the system", "has_bridge_ca"),
    "--ca": ("FILE", "the plant's authority, PEM, in place of a new one; with --cert and --key", ""),
    "--cert": ("FILE", "the broker's certificate, PEM, with what lies between it and the authority", ""),
    "--key": ("FILE", "the broker's private key, PEM", ""),
    "--like": ("DIR", "the kit of another gateway at the same broker: its authority and passwords", ""),
}
_REPEATED = ("hosts", "viewers", "auditors", "further")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's description and arguments."""
    parser.description = (
        "Write Mosquitto's configuration, access list, passwords and certificates for a gateway"
        " into a folder; with --prove, try on the running broker that each login may do what it must, and"
        " nothing else; with --lint, look for dangerous lines in a Mosquitto configuration. Exit code 1 when"
        " the proof or the look finds something."
    )
    parser.add_argument("config", metavar="CONFIG", help="the gateway's configuration")
    about = "the folder of the kit; only its owner may read it"
    parser.add_argument("folder", metavar="DIR", nargs="?", help=about)
    actions = parser.add_mutually_exclusive_group()
    flag(actions, "--prove", about="prove the kit on the running broker of CONFIG")
    about = "files of Mosquitto's configuration to look at"
    actions.add_argument("--lint", metavar="FILE", nargs="+", help=about)
    about = "write a kit again after a change of CONFIG or of the options below: stored passwords and the"
    about += " authority stay, the broker's certificate is signed again"
    flag(actions, "--update", about=about)
    flag(actions, "--force", about="replace a kit, with new passwords and certificates")
    contents = parser.add_argument_group(
        "contents of the kit (an update keeps the previous ones; '' takes one away)"
    )
    for name, (metavar, what, sets) in _CONTENTS.items():
        if sets in _REPEATED:
            contents.add_argument(name, action="append", metavar=metavar, help=f"{what}; may be repeated")
        else:
            contents.add_argument(name, metavar=metavar, help=what)


def run(args: argparse.Namespace) -> int:
    """Write, prove or look; return 1 when something is wrong."""
    config = load(args.config)
    if args.lint:
        return _lint(args.lint, config)
    if args.folder is None:
        raise UsageError("broker-kit needs the folder of the kit behind CONFIG")
    folder = Path(args.folder)
    if args.prove:
        return _prove(config, Path(args.config).parent, folder)
    if is_kit(folder) and not (args.update or args.force):
        what = "--update adds what is new, --force replaces it with its passwords"
        raise UsageError(f"{folder} holds a kit ({what})")
    given = _given(args)
    settings = _settings(args, read_settings(folder) if args.update else KitSettings())
    logins = write_kit(config, folder, settings, given, is_update=args.update)
    _describe(config, folder, settings, logins)
    return 0


def _settings(args: argparse.Namespace, stored: KitSettings) -> KitSettings:
    """Return what was stored, with what the options say in its place."""
    update: dict[str, object] = {}
    for option, (_, _, sets) in _CONTENTS.items():
        value = getattr(args, option.removeprefix("--").replace("-", "_"))
        if sets and value is not None:
            update[sets] = tuple(filter(None, value)) if sets in _REPEATED else value
    for host in filter(None, args.host or ()):
        if not _HOST.fullmatch(host):
            raise UsageError(f"--host {host!r} is no name or address")
    if "has_bridge_ca" in update:
        update["has_bridge_ca"] = bool(args.bridge_ca)
    if "further" in update:
        update["further"] = dict(_pair(text) for text in args.login if text)
    return stored.model_copy(update=update)


def _pair(text: str) -> tuple[str, str]:
    name, sign, client = text.partition("=")
    if not sign or not name or not client:
        raise UsageError(f"--login {text!r} is not NAME=OPERATOR (e.g. alice-send=alice)")
    return name, client


def _given(args: argparse.Namespace) -> GivenFiles:
    names = {name: getattr(args, name) for name in ("ca", "cert", "key")}
    if any(names.values()) and not all(names.values()):
        raise UsageError("--ca, --cert and --key go together")
    paths = {name: Path(value) for name, value in {**names, "bridge_ca": args.bridge_ca}.items() if value}
    for path in paths.values():
        if not path.is_file():
            raise UsageError(f"{path} is no file")
    if args.like and not is_kit(Path(args.like)):
        raise UsageError(f"--like {args.like} is no kit")
    return GivenFiles(**paths, like=Path(args.like) if args.like else None)


def _describe(config: Config, folder: Path, settings: KitSettings, logins: tuple[Login, ...]) -> None:
    """Print what was written, and what is the reader's to do."""
    print(f"{folder}: mosquitto.conf, acl, passwords; each login's password in {folder / FOLDER}:")
    width = max(len(login.name) for login in logins)
    for login in logins:
        whose = f" of {login.client}" if login.client not in ("", login.name) else ""
        print(f"  {login.name:{width}}  {', '.join(sorted(login.roles))}{whose}")
    if config.mqtt.is_tls:
        ends = f"is valid until {ends_on(folder / CERT)}, its authority until {ends_on(folder / CA)}"
        print(f"the broker's certificate, for {names_in(folder / CERT)}, {ends}")
        if (folder / CA_KEY).exists():
            signed = f"--update signs the next one, within {BROKER_DAYS} days"
            print(f"  {signed}; store {CA_KEY} off this machine")
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


def _lint(files: list[str], config: Config) -> int:
    found = 0
    for name in files:
        try:
            text = Path(name).read_text("utf-8")
        except (OSError, UnicodeDecodeError) as error:
            why = (error.strerror if isinstance(error, OSError) else None) or "it is not UTF-8"
            hint = "give files of Mosquitto's configuration"
            raise UsageError(f"{name}: cannot be read: {why} ({hint})") from error
        for warning in warnings(text, config.base, remote_clients(config)):
            print(f"warning {name}: {warning}")
            found += 1
    if not found:
        print("nothing dangerous found")
    return 1 if found else 0


def _prove(config: Config, place: Path, folder: Path) -> int:
    """Prove the rights of every login of the kit, and print what is wrong; 1 when something is."""
    settings = read_settings(folder)
    logins = logins_of(config, settings)
    passwords = {login.name: password_in(folder / FOLDER / login.name, key="password") for login in logins}
    findings = asyncio.run(BrokerProof(config, place, settings, logins, passwords).run())
    for finding in findings:
        print(finding)
    wrong = sum(finding.is_wrong for finding in findings)
    print(f"{sum(finding.count for finding in findings)} probes, {wrong} wrong")
    return 1 if wrong else 0
