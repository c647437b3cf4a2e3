"""Puts back the copies that an upgrade left, for an earlier version that cannot read the files since."""

from __future__ import annotations

import os
from pathlib import Path

from gateway.cli.restore.caution import HELD, LEDGER, give_to_owner_of, lock_all, note_past
from gateway.config.schema import Config
from gateway.errors import StoreError
from gateway.starters.policy.motor_history import PRECAUTIONS_FILE
from gateway.storage.database import empty_log
from gateway.storage.formats.catalogue import FileKind, Format, copy_path
from gateway.storage.formats.copies import put_in_place
from gateway.storage.upkeep.state_copy import replaced_in
from gateway.storage.upkeep.versions import found_in
from gateway.system.clock import read_clocks
from gateway.system.instance_lock import FILE, instance_lock

NEWER = ".newer"  # ends the name of a file that a copy has replaced
WHAT = "went back to the state of before an upgrade"
_COMPANIONS = ("-wal", "-shm", "-journal")  # must never stand beside another database


def roll_back(state_dir: Path, config: Config) -> None:
    """Replace every file of a later version by its copy; StoreError when one has none: then none is replaced.

    Cut short at any point, it can be repeated, and no motor is without its lock meanwhile.
    """
    with instance_lock(state_dir):
        newer = [(each, version) for each, version in found_in(state_dir) if version > each.version]
        copies = {each.name: _copy_of(state_dir, each) for each, _ in newer}
        if not newer:
            print(f"{state_dir}: this version can read every file; nothing to do")
            return
        reading, locked = read_clocks(), list[str]()
        for each, version in newer:
            path = state_dir / each.name
            if each.kind is FileKind.SQLITE:
                empty_log(path)  # or, killed before the copy is in place, this looks like an earlier version
            _retain(path)
            if each.name == PRECAUTIONS_FILE:
                locked = lock_all(state_dir, config, reading, WHAT, copies[each.name].read_bytes())
            else:
                put_in_place(copies[each.name], path)
            print(f"{each.name}: format {version} is now {path.name}{NEWER}, the copy of before is used")
        note_past(state_dir, reading, WHAT)
        give_to_owner_of(state_dir, [*replaced_in(state_dir), state_dir / FILE])
    if locked:
        print(f"locked until an operator unlocks them: {', '.join(locked)}")
    if LEDGER in copies:
        print(HELD)


def _retain(path: Path) -> None:
    """Give a file a second name, and move away what SQLite has beside it."""
    for end in _COMPANIONS:
        if os.path.lexists(f"{path}{end}"):
            os.replace(f"{path}{end}", f"{path}{NEWER}{end}")
    newer = path.with_name(path.name + NEWER)
    newer.unlink(missing_ok=True)
    newer.hardlink_to(path)


def _copy_of(state_dir: Path, known: Format) -> Path:
    path = state_dir / known.name
    for version in range(known.version, 0, -1):
        if copy_path(path, version).is_file():
            return copy_path(path, version)
    raise StoreError(f"{path} has no copy of before (restore a backup, or install the version that wrote it)")
