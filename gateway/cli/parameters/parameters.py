"""Save, compare and restore a starter's parameters through the running gateway, as an operator with the
rights `read` and `set`.
"""

from __future__ import annotations

import argparse
import asyncio
import time
from pathlib import Path

from gateway.cli.broker import add_login
from gateway.cli.command import Progress, add_starter, counted, flag, write_text
from gateway.cli.parameters.restore import restore
from gateway.cli.parameters.through_gateway import LiveStarter, variant_of
from gateway.contract import rfc3339
from gateway.errors import UsageError
from gateway.families import load_profile, reading
from gateway.starters.parameters.model import ParameterSet, differences, entries_of, of_factory
from gateway.starters.parameters.toml_file import from_toml, to_toml

_ABOUT = {
    "save": "read everything that can be read of a starter into a file",
    "diff": "print the settings in which two sets differ; exit code 1 when there are any",
    "restore": "write the settings that differ to a starter, at standstill only",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments, and a parser for each of its actions."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    save, diff, restoring = (
        actions.add_parser(name, help=about, description=f"{about[0].upper()}{about[1:]}.")
        for name, about in _ABOUT.items()
    )
    for action, about in ((save, "a new TOML file; - for the standard output"), (restoring, "a saved file")):
        add_starter(action)
        action.add_argument("file", metavar="FILE", help=about)
    diff.add_argument("a", metavar="A", help="a saved file, or CONFIG:STARTER for a live one")
    diff.add_argument("b", metavar="B", nargs="?", help="another one")
    flag(
        diff,
        "--factory",
        about="instead of B: what the starter is delivered with, as far as its serial manual prints it",
    )
    flag(diff, "--all", about="also rows that can only be read: measured values, and some settings")
    flag(restoring, "--dry-run", about="print what would be written, and write nothing")
    flag(
        restoring,
        "--command-sources",
        about="also those that say who commands the motor ([protected.command_sources]): writing them may"
        " start the motor when a run command is pending in the starter",
    )
    flag(restoring, "--other-model", about="restore also a file that was saved from another model")
    for action in (save, diff, restoring):
        add_login(action, client="the operator; may be left out when there is only one")


def run(args: argparse.Namespace) -> int:
    """Carry out one action and return the exit code."""
    if args.action == "save":
        return _save(args)
    if args.action == "diff":
        return _diff(args)
    wanted = _read_file(args.file)
    live = LiveStarter.find(args.config, args.starter, args)
    return asyncio.run(restore(live, wanted, args))


def _save(args: argparse.Namespace) -> int:
    live = LiveStarter.find(args.config, args.starter, args)
    path = None if args.file == "-" else Path(args.file)
    if path is not None and path.exists():
        raise UsageError(f"{path} exists already (a saved set is not overwritten: choose another name)")
    if path is not None and not path.parent.is_dir():
        raise UsageError(f"{path.parent} is no folder (make it first)")
    saved = _read_live(live)
    if path is None:
        print(to_toml(saved), end="")
        return 0
    write_text(path, to_toml(saved))
    refused = f", {len(saved.refused)} could not be read" if saved.refused else ""
    print(f"{path}: {len(saved.parameters)} parameters of {saved.name}{refused}")
    return 0


def _diff(args: argparse.Namespace) -> int:
    if args.factory and args.b is not None:
        raise UsageError(f"--factory takes the place of {args.b} (leave one of them out)")
    if not args.factory and args.b is None:
        raise UsageError("name a second set, or give --factory")
    before = _set(args.a, args)
    profile = load_profile(before.family)
    if args.factory:
        before, after = of_factory(profile, before)
        if not after.parameters:
            what = f"{args.a} holds nothing whose factory setting the manual of {profile.title} prints"
            raise UsageError(what)
    else:
        after = _set(args.b, args)
    if before.family != after.family:
        raise UsageError(f"{args.a} is of family {before.family}, {args.b} of {after.family}: not comparable")
    found = differences(before, after, profile=profile, with_readings=args.all and not args.factory)
    for difference in found:
        print(difference.text)
    if args.factory:
        same = [code for code in after.parameters if code not in {each.code for each in found}]
        print(f"as delivered: {', '.join(same) or 'none'}")
    elif not found:
        what = "no difference" if args.all else "no setting differs"
        unseen = len(differences(before, after, profile=profile, with_readings=True))
        more = f" (--all shows {counted(unseen, 'row')} that can only be read)" if unseen else ""
        print(f"{what} between {args.a} and {args.b}{more}")
    return 1 if found else 0


def _set(name: str, args: argparse.Namespace) -> ParameterSet:
    """Return a file's set, or that of a starter given as CONFIG:STARTER."""
    config, colon, starter = name.rpartition(":")
    if Path(name).exists() or not colon:
        return _read_file(name)
    return _read_live(LiveStarter.find(config, starter, args))


def _read_file(path: str) -> ParameterSet:
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not UTF-8"
        raise UsageError(f"{path}: {reason} (name a file of `parameters save`)") from error
    return from_toml(text, path)


def _read_live(live: LiveStarter) -> ParameterSet:
    """Read everything of a starter, with a progress line."""

    async def read() -> ParameterSet:
        info = await live.info()
        read = await live.read(reading.readable_codes(live.profile), Progress())
        entries = entries_of(live.profile, variant_of(info), read.rows)
        taken, ids = rfc3339(time.time()) or "", (info.model, info.firmware, info.serial)
        return ParameterSet(live.name, live.profile.family, taken, *ids, entries, read.refused)

    return asyncio.run(read())
