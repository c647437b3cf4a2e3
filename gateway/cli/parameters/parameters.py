"""`starter-gateway parameters`: saves, compares and restores a starter's parameters."""

from __future__ import annotations

import argparse
from pathlib import Path

from gateway.cli.command import Progress, flag
from gateway.cli.parameters.live import LiveStarter, save_live
from gateway.cli.parameters.restore import run_restore
from gateway.errors import UsageError
from gateway.families import load_profile
from gateway.starters.parameters.model import ParameterSet, differences, of_factory
from gateway.starters.parameters.toml_file import from_toml, to_toml


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments, and a parser for each of its actions."""
    parser.description = (
        "Save, compare and restore a starter's parameters. The port is used directly: a gateway"
        " that runs on it must be stopped before."
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    save = actions.add_parser(
        "save",
        help="read everything that can be read into a file",
        description="Read everything that can be read of a starter into a file.",
    )
    _add_starter(save)
    save.add_argument("file", metavar="FILE", help="a new TOML file; - for the standard output")
    flag(save, "--unnamed", about="P000 to P999 too, as raw words (SSW-06, SSW-07)")
    diff = actions.add_parser(
        "diff",
        help="print the settings in which two sets differ; exit code 1 when there are any",
        description="Print the settings in which two sets differ; exit code 1 when there are any.",
    )
    diff.add_argument("a", metavar="A", help="a saved file, or CONFIG:STARTER for a live one")
    diff.add_argument("b", metavar="B", nargs="?", help="another one")
    flag(
        diff,
        "--factory",
        about="instead of B: what the starter is delivered with, as far as its serial manual prints it",
    )
    flag(diff, "--all", about="measured values too, not the settings alone")
    restore = actions.add_parser(
        "restore",
        help="write the settings that differ, at standstill only",
        description="Write the settings that differ to a starter, at standstill only.",
    )
    _add_starter(restore)
    restore.add_argument("file", metavar="FILE", help="a file of `parameters save`")
    flag(restore, "--dry-run", about="print what would be written, and write nothing")
    flag(
        restore,
        "--command-sources",
        about="also those that say who commands the motor ([protected.command_sources]): may start it when"
        " a run command stands there",
    )
    flag(restore, "--other-model", about="restore also a file that was saved from another model")


def run(args: argparse.Namespace) -> int:
    """Carry out one action and return the exit code."""
    progress = Progress()
    if args.action == "save":
        return _save(args, progress)
    if args.action == "diff":
        return _diff(args, progress)
    wanted = read_file(args.file)
    return run_restore(LiveStarter.find(args.config, args.starter), wanted, args, progress)


def read_file(path: str) -> ParameterSet:
    """Return a saved set; UsageError when there is none."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not UTF-8"
        raise UsageError(f"{path}: {reason} (name a file of `parameters save`)") from error
    return from_toml(text, path)


def _add_starter(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("config", metavar="CONFIG", help="the gateway's configuration")
    parser.add_argument("starter", metavar="STARTER", help="the starter's name")


def _save(args: argparse.Namespace, progress: Progress) -> int:
    path = None if args.file == "-" else Path(args.file)
    live = LiveStarter.find(args.config, args.starter)
    if path is not None and path.exists():
        raise UsageError(f"{path} exists already (a saved set is not overwritten: choose another name)")
    if path is not None and not path.parent.is_dir():
        raise UsageError(f"{path.parent} is no folder (make it first)")
    saved = save_live(live, progress, with_unnamed=args.unnamed)
    if path is None:
        print(to_toml(saved), end="")
        return 0
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(to_toml(saved))
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror} (choose another folder)") from error
    refused = f", {len(saved.refused)} could not be read" if saved.refused else ""
    print(f"{path}: {len(saved.parameters)} parameters of {saved.starter}{refused}")
    return 0


def _diff(args: argparse.Namespace, progress: Progress) -> int:
    if args.factory:
        return _diff_factory(args, progress)
    if args.b is None:
        raise UsageError("name a second set, or give --factory")
    before, after = (_set(name, progress) for name in (args.a, args.b))
    if before.family != after.family:
        raise UsageError(f"{args.a} is of family {before.family}, {args.b} of {after.family}: not comparable")
    found = differences(before, after, profile=load_profile(before.family), with_readings=args.all)
    for difference in found:
        print(difference.text)
    if not found:
        what = "no difference" if args.all else "no setting differs"
        print(f"{what} between {args.a} and {args.b}")
    return 1 if found else 0


def _diff_factory(args: argparse.Namespace, progress: Progress) -> int:
    if args.b is not None:
        raise UsageError(f"--factory takes the place of {args.b} (leave one of them out)")
    given = _set(args.a, progress)
    profile = load_profile(given.family)
    factory, held = of_factory(profile, given)
    if not held.parameters:
        raise UsageError(f"{args.a} holds nothing whose factory setting the manual of {profile.title} prints")
    found = differences(factory, held, profile=profile)
    for difference in found:
        print(difference.text)
    same = [code for code in held.parameters if code not in {each.code for each in found}]
    print(f"as delivered: {', '.join(same) or 'none'}")
    return 1 if found else 0


def _set(name: str, progress: Progress) -> ParameterSet:
    """Return a file's set, or that of a starter given as CONFIG:STARTER."""
    config, colon, starter = name.rpartition(":")
    if Path(name).exists() or not colon:
        return read_file(name)
    return save_live(LiveStarter.find(config, starter), progress)
