"""Store a gateway's configuration, the files it refers to, and its state in one file, also while the gateway
runs. Without --secrets passwords, private keys and tokens are left out.
"""

from __future__ import annotations

import argparse
import glob
import logging
import os
import shutil
import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from gateway import __version__
from gateway.app.site import Site
from gateway.cli.command import counted, flag
from gateway.config import Config, files_of, load, without_logins
from gateway.contract import rfc3339
from gateway.errors import GatewayError, StartError, StoreError, UsageError
from gateway.store import backup, is_import_due
from gateway.system.instance_lock import is_locked

log = logging.getLogger(__name__)

BEFORE_UPGRADE = (
    "before-upgrade.tar.gz"  # in the state directory, with passwords and keys, as they are beside it
)
CONFIG, OUTSIDE, STATE = "config", "outside", "state"  # folders in a backup
GZIP = b"\x1f\x8b"  # what a backup begins with [RFC 1952]
PRIVATE = b"PRIVATE KEY-----"  # in a PEM file [RFC 7468], also one that is named as a certificate


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("config", metavar="CONFIG", help="the gateway's configuration")
    parser.add_argument("file", metavar="FILE", help="the backup to write, such as mcc1.tar.gz")
    flag(parser, "--secrets", about="with passwords, private keys and tokens")


def run(args: argparse.Namespace) -> int:
    """Write the backup, say what is in it, and return 0."""
    path, file = Path(args.config), Path(args.file)
    config = load(path)
    state_dir = path.parent / config.gateway.state_dir
    if is_import_due(state_dir) and is_locked(state_dir):
        raise StartError(f"a gateway of 0.2.0 runs with state_dir {state_dir}", "stop it for the backup")
    try:
        facts = back_up(path, config, _checked_target(file), with_secrets=args.secrets)
        octets = file.stat().st_size
    except OSError as error:
        raise StoreError(f"{error.filename or file}: {error.strerror or error}") from error
    configured = sum(not each.startswith(f"{STATE}/") for each in facts.files) - 1
    print(f"configuration {path} and {counted(configured, 'file')} that it refers to")
    print(f"state of {state_dir}: {', '.join(facts.state) or 'nothing yet'}")
    if facts.has_secrets:
        print(f"warning: {file} holds passwords and keys: store it as safely as those (its mode is 0600)")
    elif left_out := missing_in(facts):
        print(f"left out (--secrets takes them): {', '.join(left_out)}")
    print(f"{file}: {octets} bytes")
    return 0


def back_up(path: Path, config: Config, file: Path, *, with_secrets: bool) -> backup.Manifest:
    """Write a backup, and return what it says of itself; StoreError, OSError.

    The copies are made beside it, for their owner alone; those that a killed process has left are deleted.
    """
    state_dir, begin, end = path.parent / config.gateway.state_dir, f".{file.name}.", ".copies"
    for left in file.parent.glob(f"{glob.escape(begin)}*{end}"):
        shutil.rmtree(left, ignore_errors=True)
    with TemporaryDirectory(end, begin, file.parent) as own_folder:  # never that of another backup
        copies = Path(own_folder)
        (copies / STATE).mkdir()
        versions = backup.copy_state(state_dir, copies / STATE) if state_dir.is_dir() else {}
        state = [backup.Member(f"{STATE}/{name}", copies / STATE / name, state_dir) for name in versions]
        text, logins = path.read_text("utf-8"), list[str]()
        if not with_secrets:
            text, logins = without_logins(text, config)
        (copies / CONFIG).write_text(text, "utf-8")
        own = backup.Member(f"{CONFIG}/{path.name}", copies / CONFIG, path)
        configured, left_out = _configured(folder_of(path), files_of(config), with_secrets=with_secrets)
        facts = backup.Manifest(
            version=__version__,
            made=rfc3339(time.time()) or "",
            gateway=config.gateway.name,
            config=path.name,
            folder=str(folder_of(path)),
            state_dir=str(config.gateway.state_dir),
            has_secrets=with_secrets,
            left_out=left_out,
            logins=logins,
            state=versions,
        )
        backup.write_archive(file, facts, [own, *configured, *state])
        return facts


def upgrade_site(path: Path, site: Site) -> None:
    """Take a gateway's state to this version, if it is of an earlier one, after a backup of both.

    Neither prevents the start: the starters are watched without a backup rather than not at all. An upgrade
    that fails is tried again by the store, which is away as long as that is not possible.
    """
    if not backup.is_upgrade_due(site.state_dir):
        return
    try:
        back_up(path, site.config, site.state_dir / BEFORE_UPGRADE, with_secrets=True)
        log.info("state_dir %s is of an earlier version; backup: %s", site.state_dir, BEFORE_UPGRADE)
    except (OSError, GatewayError) as error:
        log.error("no backup before the upgrade of %s: %s", site.state_dir, error)  # noqa: TRY400 - one line
    try:
        backup.upgrade(site.state_dir)
    except GatewayError as error:
        log.error("state_dir %s was not upgraded: %s", site.state_dir, error)  # noqa: TRY400 - one line


def missing_in(facts: backup.Manifest) -> list[str]:
    """Return what was left out of a backup."""
    return [*facts.left_out, *(f"the password of login {each}" for each in facts.logins)]


def folder_of(path: Path) -> Path:
    """Return a configuration's folder as a whole path, without steps upwards."""
    folder = path.absolute().parent
    return folder.resolve() if ".." in folder.parts else folder


def name_in_backup(folder: Path, path: Path) -> str:
    """Return the name of a configuration's file: below its folder as it is, else by its whole path."""
    whole = Path(os.path.normpath(folder / path))
    if whole.is_relative_to(folder):
        return f"{CONFIG}/{whole.relative_to(folder)}"
    return f"{OUTSIDE}{whole}"


def _checked_target(file: Path) -> Path:
    """Return where the backup goes, also behind a link; UsageError for what it must not replace."""
    target = Path(os.path.realpath(file))
    may_write = target.parent.is_dir() and not os.path.lexists(target)
    if target.is_file():
        with target.open("rb") as content:
            may_write = content.read(len(GZIP)) in (GZIP, b"")
    if not may_write:
        what = "is there, and no backup" if target.exists() else "cannot be written: there is no such folder"
        raise UsageError(f"{file} {what} (name a file to be written, such as mcc1.tar.gz)")
    return target


def _configured(
    folder: Path, files: Mapping[Path, bool], *, with_secrets: bool
) -> tuple[list[backup.Member], list[str]]:
    """Return the files that a configuration refers to as members, and those that are left out."""
    members, left_out = dict[str, backup.Member](), list[str]()
    secrets = {(folder / each).resolve() for each, is_secret in files.items() if is_secret}
    for each in files:
        where, name = folder / each, name_in_backup(folder, each)
        if not with_secrets and (where.resolve() in secrets or PRIVATE in where.read_bytes()):
            left_out.append(str(each))
        else:
            members[name] = backup.Member(name, where, where)  # one that two keys name is there once
    return list(members.values()), left_out
