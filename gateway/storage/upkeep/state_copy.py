"""A state directory's files, copied while a gateway may be writing them.

Each file is as it was at one moment; different files may be of moments a second apart. Locks, sockets, and
files that were set aside are left out.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from gateway.errors import DamagedError, StoreError
from gateway.storage.formats import LOCK_FILE, OWN_NAMES, require_known
from gateway.store import SCHEMAS, snapshot, stored_version

BEFORE = "before-restore"  # folder in the state directory with the files that a restore has replaced


def copy_state(state_dir: Path, to: Path) -> dict[str, int]:
    """Copy the files into a folder and return the version of each; StoreError, OSError."""
    versions: dict[str, int] = {}
    os.listdir(state_dir)  # where this is not permitted, nothing in it seems to exist
    for name, schema in SCHEMAS.items():
        source = state_dir / name
        if not source.exists():
            continue
        version = stored_version(source, schema)
        if version is None and not os.access(source, os.R_OK):
            raise StoreError(f"{source} may not be read by this user (make the backup as root)")
        if version is None:
            raise DamagedError(
                f"{source} is damaged (start the gateway once, which sets it aside, or move it away)"
            )
        require_known(source, version)
        snapshot(source, to / name)
        versions[name] = version
    return versions


def is_state_name(name: str) -> bool:
    """Return whether a backup may hold a file of this name, relative to the state directory."""
    return name in SCHEMAS


def replaced_in(state_dir: Path) -> list[Path]:
    """Return what a restore replaces: a gateway's own files, with SQLite's beside them."""
    paths = own_files(state_dir) if state_dir.is_dir() else ()
    return sorted(path for path in paths if not path.name.startswith(LOCK_FILE))


def own_files(state_dir: Path) -> Iterator[Path]:
    """Yield what is a gateway's own in a folder, whatever it is: a folder may be in the way of a file."""
    yield from (path for path in state_dir.iterdir() if OWN_NAMES.fullmatch(path.name))


def set_aside(state_dir: Path, paths: list[Path], *, is_going_on: bool) -> Path:
    """Move files into a folder of their own, in place of what an earlier restore put there.

    Where it goes on with a restore that was cut short, what that one put there stays, and files that it has
    put in their place are deleted.
    """
    aside = state_dir / BEFORE
    if aside.exists() and not is_going_on:
        shutil.rmtree(aside)
    aside.mkdir(mode=0o700, exist_ok=True)
    for path in paths:
        to = aside / path.relative_to(state_dir)
        to.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not os.path.lexists(to):
            path.rename(to)
        elif path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
    return aside
