"""A state directory's files, copied while a gateway may be writing them.

Each file is as it was at one moment; different files may be of moments a second apart. Locks, sockets, and
files that were set aside are left out.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

from gateway.errors import DamagedError, StoreError
from gateway.storage.audit.segments import ANCHOR, FOLDER, LOCK
from gateway.storage.database import snapshot
from gateway.storage.formats import LOCK_FILE, OWN_NAMES, STATE_FILES, FileKind, require_known
from gateway.storage.json_file import JsonFile
from gateway.storage.upkeep.versions import version_of

BEFORE = "before-restore"  # folder in the state directory with the files that a restore has replaced
_SEGMENT = re.compile(r"audit-\d{8}\.jsonl", re.ASCII)


def copy_state(state_dir: Path, to: Path) -> dict[str, int]:
    """Copy the files into a folder and return the version of each; StoreError, OSError."""
    versions: dict[str, int] = {}
    os.listdir(state_dir)  # where this is not permitted, nothing in it seems to exist
    for each in STATE_FILES.values():
        source, copy = state_dir / each.name, to / each.name
        if not source.exists():
            continue
        version = version_of(source, each.kind)
        if version is None and not os.access(source, os.R_OK):
            raise StoreError(f"{source} may not be read by this user (make the backup as root)")
        if version is None:
            raise DamagedError(
                f"{source} is damaged (start the gateway once, which sets it aside, or move it away)"
            )
        require_known(source, version)
        copy.parent.mkdir(parents=True, exist_ok=True)
        if each.kind is FileKind.SQLITE:
            snapshot(source, copy)
        else:
            shutil.copyfile(source, copy)
            if JsonFile(copy).version() is None:
                raise DamagedError(f"{source} cannot be read")
        versions[each.name] = version
    if (state_dir / FOLDER).is_dir():
        _copy_audit(state_dir / FOLDER, to / FOLDER)
    return versions


def is_state_name(name: str) -> bool:
    """Return whether a backup may hold a file of this name, relative to the state directory."""
    known = {each.name for each in STATE_FILES.values()}
    folder, _, file = name.rpartition("/")
    return name in known or (folder == FOLDER and (file == ANCHOR or bool(_SEGMENT.fullmatch(file))))


def replaced_in(state_dir: Path) -> list[Path]:
    """Return what a restore replaces: a gateway's own files, with SQLite's beside them."""
    paths = own_files(state_dir) if state_dir.is_dir() else ()
    return sorted(path for path in paths if path.name != LOCK and not path.name.startswith(LOCK_FILE))


def own_files(state_dir: Path) -> Iterator[Path]:
    """Yield what is a gateway's own in a folder, whatever it is: a folder may be in the way of a file."""
    parents = {state_dir, *(state_dir / Path(each.name).parent for each in STATE_FILES.values())}
    for folder in parents:
        for path in folder.iterdir() if folder.is_dir() else ():
            if OWN_NAMES.fullmatch(path.name):
                yield path
    for folder in {*parents, state_dir / FOLDER} - {state_dir}:
        if os.path.lexists(folder) and not folder.is_dir():
            yield folder
    if (state_dir / FOLDER).is_dir():
        yield from (state_dir / FOLDER).iterdir()


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


def _copy_audit(folder: Path, to: Path) -> None:
    """Copy segments up to their last whole line; the anchor last: it excludes what was removed meanwhile."""
    to.mkdir(parents=True, exist_ok=True)
    for name in sorted(name for name in os.listdir(folder) if _SEGMENT.fullmatch(name)):
        try:
            octets = (folder / name).read_bytes()
        except FileNotFoundError:
            continue
        (to / name).write_bytes(octets[: octets.rfind(b"\n") + 1])
    if (folder / ANCHOR).exists():
        shutil.copyfile(folder / ANCHOR, to / ANCHOR)
