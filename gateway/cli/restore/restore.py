"""Put back what a backup holds. The gateway must not run. Afterwards every starter that can be locked is
locked: what happened since the backup is not known.

Everything is verified before anything is written. Nothing is written outside the configuration's folder and
the state directory, over files that are there without --replace, or beside a running gateway.

The state is older than what has happened since:

1. A command that was carried out since is not in the ledger. A copy of it does not act: neither its `token`
   nor its `issued_at` proves it fresh to another run (docs/upgrade.md).
2. A maintenance lock that was set since is not known: each starter that may be locked is locked.
3. Starts are as old as they were in the backup, and age by this machine's clocks from now on.
4. Sparkplug's number of births must not be one that its hosts have just seen: it goes on half way round.
5. The audit says that it was restored.
"""

from __future__ import annotations

import argparse
import os
import shutil
from collections.abc import Iterable, Mapping
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import NamedTuple

from gateway.cli.command import flag
from gateway.cli.restore.backup import CONFIG, OUTSIDE, STATE, missing_in, name_in_backup
from gateway.config import Config, files_of, load, parse, rights_of
from gateway.errors import ConfigError, DamagedError, StartError, StoreError
from gateway.plugins.sparkplug.numbers import BIRTHS, NUMBER
from gateway.plugins.sparkplug.settings import SEQ_NUMBERS
from gateway.starters import lock_restored
from gateway.store import STATE_FILE, append_note, backup, read_document, write_document
from gateway.system.clock import read_clocks
from gateway.system.instance_lock import FILE, instance_lock, is_locked
from gateway.system.whole_files import sync_file

ASIDE = "before-restore"  # with a number: a folder in the state directory, and the end of a file's name
RESTORED = ".restored"  # ends the name of a configuration's file that is to be in place soon
STAGE = "restoring"  # a folder in the state directory


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("file", metavar="FILE", help="the backup")
    parser.add_argument("--to", metavar="DIR", help="put everything below this folder, not where it was")
    flag(parser, "--replace", about="replace what is there; it is set aside")


def run(args: argparse.Namespace) -> int:
    """Restore, print what was done, and return 0."""
    if not Path(args.file).exists():
        raise StoreError(f"{args.file}: No such file or directory (name a file that `backup` has written)")
    try:
        with backup.open_archive(Path(args.file)) as archive:
            _restore(archive, None if args.to is None else Path(args.to), is_replacing=args.replace)
    except OSError as error:
        raise StoreError(f"{error.filename or args.file}: {error.strerror or error}") from error
    return 0


def _restore(archive: backup.Archive, to: Path | None, *, is_replacing: bool) -> None:
    place = _place(archive, to)
    if not is_replacing and (there := [*filter(os.path.lexists, place.files), *place.old_state()]):
        what = f"already there: {', '.join(str(path) for path in there[:3])}"
        raise StartError(what, "--replace sets them aside, --to DIR restores elsewhere")
    with suppress(ConfigError, OSError):
        state_dir = place.folder / load(place.path).gateway.state_dir
        if state_dir != place.state_dir and is_locked(state_dir):
            raise StartError(f"a gateway runs by {place.path}, with state_dir {state_dir}", "stop that one")
    is_new = not place.state_dir.exists()
    place.folder.mkdir(parents=True, exist_ok=True)
    with instance_lock(place.state_dir):
        if is_new or place.state_dir.stat().st_uid == 0:  # as root: whose the state was
            for stored in list(place.state.values())[:1]:
                _give_to(place.state_dir, *archive.rights(stored)[1:])
        _give_to_owner_of(place.state_dir, [place.state_dir / FILE])
        stage, aside = place.state_dir / STAGE, place.state_dir / _unused_name(place)
        shutil.rmtree(stage, ignore_errors=True)  # of a restore that was cut short
        stage.mkdir(mode=0o700)
        try:
            locked = _write_state(archive, place, stage)
            _write_configured(archive, place)
            old = _linked(place, aside)
        except BaseException:
            for folder in (stage, aside):
                shutil.rmtree(folder, ignore_errors=True)
            for path in place.files:
                _restored(path).unlink(missing_ok=True)
            raise
        try:
            _switch(place, stage, old, aside)
        except OSError as error:
            what = f"{error.filename or place.state_dir}: {error.strerror}"
            hint = "correct this, then restore once more with --replace; what was there is set aside"
            raise StoreError(f"{what}; the gateway has no configuration now ({hint})") from error
    if old:
        print(f"set aside: the state that was there, as {aside}")
    _report(archive.manifest, place, locked)


def _linked(place: _Place, aside: Path) -> list[Path]:
    """Link the state that is there into a folder of its own, which is whole before anything else changes."""
    if old := place.old_state():
        aside.mkdir(mode=0o700)
    for path in old:
        to = aside / path.relative_to(place.state_dir)
        to.parent.mkdir(mode=0o700, exist_ok=True)
        os.link(path, to, follow_symlinks=False)
        sync_file(to.parent)
    sync_file(place.state_dir)
    return old


def _switch(place: _Place, stage: Path, old: list[Path], aside: Path) -> None:
    """Put in place what was written, of which the configuration comes last.

    It goes first: cut short, this leaves none, so that no gateway starts by half of it. Nothing that is set
    aside is ever replaced, also not by the same restore again.
    """
    for path in place.files:
        if os.path.lexists(path):
            path.replace(path.with_name(f"{path.name}.{aside.name}"))
    for path in old:
        path.unlink()
    new = [path.relative_to(stage) for path in stage.rglob("*") if path.is_file()]
    for path in new:
        (place.state_dir / path).parent.mkdir(mode=0o700, exist_ok=True)
        (stage / path).replace(place.state_dir / path)
    own = {place.state_dir / each for path in new for each in (path, *path.parents)} - {place.state_dir}
    _give_to_owner_of(place.state_dir, [*own, *([aside, *aside.rglob("*")] if old else [])])
    for path in reversed(list(place.files)):
        _restored(path).replace(path)
        sync_file(path.parent)
    shutil.rmtree(stage, ignore_errors=True)


def _unused_name(place: _Place) -> str:
    def is_used(name: str) -> bool:
        asides = (Path(f"{path}.{name}") for path in place.files)
        return any(os.path.lexists(path) for path in (place.state_dir / name, *asides))

    return next(name for number in count(1) if not is_used(name := f"{ASIDE}-{number}"))


class _Place(NamedTuple):
    """Where everything goes, with its name in the backup."""

    config: Config
    folder: Path
    state_dir: Path
    files: Mapping[Path, str]  # the configuration and those that it names
    state: Mapping[str, str]  # by the name in the state directory

    @property
    def path(self) -> Path:
        """Return where the configuration goes, the first of the files."""
        return next(iter(self.files))

    def old_state(self) -> list[Path]:
        """Return what a restore replaces in the state directory: a gateway's own files."""
        paths = backup.own_files(self.state_dir) if self.state_dir.is_dir() else ()
        return sorted(path for path in paths if not path.name.startswith(FILE))


def _place(archive: backup.Archive, to: Path | None) -> _Place:
    """Return where a backup goes; DamagedError for files that its configuration does not name."""
    facts, before = archive.manifest, Path(archive.manifest.folder)
    folder, own = before if to is None else to.absolute(), f"{CONFIG}/{facts.config}"
    is_named = before.is_absolute() and name_in_backup(before, Path(facts.config)) == own
    if not is_named or "/" in facts.config or own not in facts.files:
        raise DamagedError("the backup does not say which file is its configuration")
    config = parse(archive.read(own).decode("utf-8", "replace"), str(folder / facts.config))
    state = {name.removeprefix(f"{STATE}/"): name for name in facts.files if name.startswith(f"{STATE}/")}
    known = {own, *(name_in_backup(before, path) for path in files_of(config))}
    known |= {name for within, name in state.items() if backup.is_state_name(within)}
    if foreign := [name for name in facts.files if name not in known]:
        raise DamagedError(f"the backup holds {foreign[0]}, which its configuration does not name")
    state_dir = folder / config.gateway.state_dir
    if to is not None:  # below that folder, whatever the configuration says
        state_dir = Path(os.path.normpath(state_dir))
        state_dir = state_dir if state_dir.is_relative_to(folder) else folder / STATE
    names = [own, *(name for name in facts.files if name not in (own, *state.values()))]
    return _Place(
        config, folder, state_dir, {folder / name.removeprefix(f"{CONFIG}/"): name for name in names}, state
    )


def _write_state(archive: backup.Archive, place: _Place, stage: Path) -> list[str]:
    """Write the state as it is to be; return the starters that are locked in it. StoreError."""
    what, path = f"restored from a backup of {archive.manifest.made}", stage / STATE_FILE
    for name, stored in sorted(place.state.items()):
        archive.extract(stored, stage / name)
    backup.upgrade(stage)
    locked = lock_restored(
        path,
        [starter.name for starter in place.config.starters],
        is_lockable=rights_of(place.config).is_lockable,
        reading=read_clocks(),
        reason=f"{what}: locks and starts since then are not known; look, then unlock",
    )
    with suppress(DamagedError):
        births = read_document(path, BIRTHS, NUMBER)
        if births is not None:
            write_document(path, BIRTHS, NUMBER, (births + SEQ_NUMBERS // 2) % SEQ_NUMBERS)
    append_note(path, "state_restored", what)
    for folder in (stage, *(path for path in stage.rglob("*") if path.is_dir())):
        sync_file(folder)
    return locked


def _write_configured(archive: backup.Archive, place: _Place) -> None:
    """Write the configuration and what it refers to beside their places, each for those who might read it."""
    for place_of_file, stored in place.files.items():
        path = _restored(place_of_file)
        path.parent.mkdir(parents=True, exist_ok=True)
        archive.extract(stored, path)
        mode, user, group = archive.rights(stored)
        path.chmod(mode)
        _give_to(path, user, group)
        sync_file(path.parent)


def _restored(path: Path) -> Path:
    return path.with_name(path.name + RESTORED)


def _give_to_owner_of(folder: Path, paths: Iterable[Path]) -> None:
    """As root, give files to the owner of a folder: the gateway's user must read and write them."""
    if os.geteuid() == 0:
        owner = folder.stat()
        for path in paths:
            os.chown(path, owner.st_uid, owner.st_gid, follow_symlinks=False)


def _give_to(path: Path, user: str, group: str) -> None:
    """As root, give a file to a user and a group by name, where this machine has them."""
    if os.geteuid() == 0:
        for names in ({"user": user}, {"group": group}):
            with suppress(LookupError):
                shutil.chown(path, **names)


def _report(facts: backup.Manifest, place: _Place, locked: list[str]) -> None:
    config, folder = place.config, place.folder
    print(f"gateway {config.gateway.name}, backup of {facts.made} by version {facts.version}")
    print(f"configuration: {len(place.files)} files in {folder}")
    print(f"state: {len(place.state)} files in {place.state_dir}")
    moved = files_of(config) if folder != Path(facts.folder) else ()
    elsewhere = [str(each) for each in moved if (folder / each).is_relative_to(facts.folder)]
    if folder / config.gateway.state_dir != place.state_dir:
        elsewhere.append(str(config.gateway.state_dir))
    if elsewhere:
        print(f"the configuration names places that are others now: change {', '.join(elsewhere)}")
    if any(name.startswith(f"{OUTSIDE}/") for name in place.files.values()):
        print(f"files of other folders are below {folder / OUTSIDE}: put each where it belongs")
    if missing := missing_in(facts):
        print(f"not in the backup, to be given again: {', '.join(missing)}")
    if locked:
        print(f"locked until an operator unlocks them: {', '.join(locked)}")
    print(f"then: starter-gateway check {place.path}")
