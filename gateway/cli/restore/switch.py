"""Puts what a restore has written in place of what was there: all of it is on the disk before anything moves.

A full disk, or an end of the process, before that leaves everything as it was. Cut short while files move, it
leaves no configuration, so that no gateway starts by half of it; the same restore again goes on, and what
was there before the first one stays set aside.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable
from pathlib import Path

from gateway.cli.restore.caution import give_to_owner_of
from gateway.errors import StoreError
from gateway.store import backup
from gateway.system.whole_files import sync_folder

BEFORE = ".before-restore"  # ends the name of a configuration's file that was replaced
ASIDE = "before-restore"  # folder in the state directory with the files that were replaced there
RESTORED = ".restored"  # ends the name of one that is to be in place soon
_STAGE, _WHOLE = "restoring.new", "restoring"  # folders in the state directory: being written, and complete


class Switch:
    """From one configuration and its state to another; files of the configuration by their whole paths."""

    def __init__(self, state_dir: Path, config: Path, others: Iterable[Path]) -> None:
        self._state_dir = state_dir
        self._config = config
        self._configured = [config, *others]
        self._whole = state_dir / _WHOLE
        self.is_going_on = self._whole.is_dir() and not os.path.lexists(config)
        self.stage = state_dir / _STAGE

    def begin(self) -> None:
        """Make an empty folder for the state, `stage`; OSError."""
        shutil.rmtree(self.stage, ignore_errors=True)
        self.stage.mkdir(mode=0o700)

    def give_up(self) -> None:
        """Delete what was written so far."""
        shutil.rmtree(self.stage, ignore_errors=True)
        for path in self._configured:
            _named(path, RESTORED).unlink(missing_ok=True)

    def seal(self) -> None:
        """Have all that was written on the disk; OSError."""
        shutil.rmtree(self._whole, ignore_errors=True)
        for folder in {path.parent for path in (*self.stage.rglob("*"), *self._configured)}:
            sync_folder(folder)
        self.stage.replace(self._whole)

    def complete(self) -> Path | None:
        """Put everything in place, the configuration last; return where the state of before is, if any.

        StoreError when it was cut short.
        """
        try:
            return self._move()
        except OSError as error:
            what = f"{error.filename}: {error.strerror}; the gateway has no configuration now"
            hint = "correct this, then restore once more with --replace; what was there is set aside"
            raise StoreError(f"{what} ({hint})") from error

    def _move(self) -> Path | None:
        for path in self._configured:
            if os.path.lexists(path) and not (self.is_going_on and os.path.lexists(_named(path, BEFORE))):
                path.replace(_named(path, BEFORE))
        own = replaced_in(self._state_dir)
        aside = self._set_aside(own) if own else None
        if aside is not None:
            give_to_owner_of(self._state_dir, [aside, *aside.rglob("*")])
        for path in sorted(self._whole.rglob("*")):  # folders come before what is in them
            to = self._state_dir / path.relative_to(self._whole)
            if not path.is_dir():
                path.replace(to)
            elif not to.is_dir():
                to.mkdir(mode=0o700)
                give_to_owner_of(self._state_dir, [to])
        for path in reversed(self._configured):
            sync_folder(path.parent)
            _named(path, RESTORED).replace(path)
        sync_folder(self._config.parent)
        shutil.rmtree(self._whole, ignore_errors=True)
        return aside

    def _set_aside(self, paths: list[Path]) -> Path:
        """Move files into a folder of their own, in place of what an earlier restore put there.

        Where it goes on with a restore that was cut short, what that one put there stays, and files that it
        has put in their place are deleted.
        """
        aside = self._state_dir / ASIDE
        if aside.exists() and not self.is_going_on:
            shutil.rmtree(aside)
        aside.mkdir(mode=0o700, exist_ok=True)
        for path in paths:
            to = aside / path.relative_to(self._state_dir)
            to.parent.mkdir(mode=0o700, exist_ok=True)
            if not os.path.lexists(to):
                path.rename(to)
            elif path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
        return aside


def replaced_in(state_dir: Path) -> list[Path]:
    """Return what a restore replaces: a gateway's own files, with SQLite's beside them."""
    paths = backup.own_files(state_dir) if state_dir.is_dir() else ()
    return sorted(path for path in paths if not path.name.startswith(backup.LOCK_FILE))


def _named(path: Path, ending: str) -> Path:
    return path.with_name(path.name + ending)
